"""Rodas5P: Rosenbrock method of order 5 for M y' = f(t, y) with M = diag(1 … 1, 0 … 0), stiffly accurate, L-stable.

It has an estimate of order 4 and a polynomial of order 4 within a step. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical
benchmarks within the Julia Differential Equations package, BIT Numerical Mathematics 63, 27, 2023. A step solves eight linear systems with one
matrix, without iteration. With J = df/dy and df/dt at the start of a step of length h its stages are (Hairer and Wanner, Solving ODEs II, section
IV.7, without products by J)
    (M/(GAMMA h) - J) U_i = f(t + C_i h, y + sum_j A_ij U_j) + M sum_j COUPLING_ij U_j / h + D_i h df/dt.
The last two stages evaluate f at the result of the stage before them and its U. So does the end of the step; the last U is the estimate.
"""

import numpy as np

STAGES = 8
GAMMA = 0.21193756319429014
C = (0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0)
D = (
    0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0,
)  # fmt: skip
WRITTEN = 6  # number of stages with weights in A
# Rows below the diagonal, one after the other: that of stage i begins at i (i - 1)/2.
A = (
    3.0,
    2.849394379747939, 0.45842242204463923,
    -6.954028509809101, 2.489845061869568, -10.358996098473584,
    2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641,
    -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946,
)  # fmt: skip
COUPLING = (
    -14.155112264123755,
    -17.97296035885952, -2.859693295451294,
    147.12150275711716, -1.41221402718213, 71.68940251302358,
    165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306,
    24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471,
    30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623, -28.087943162872662,
    37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002, -54.66780262877968,
    -9.48861652309627,
)  # fmt: skip
# Within a step y(s) = y0 + s (y1 - y0 + (1 - s) (H0 + s H1 + s^2 H2) U) at a fraction s of it.
_H = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722],
])  # fmt: skip
ROWS = 3
# the same in powers of s and 1 - s in turns, as `dop853.polynomial`
WITHIN = tuple(np.stack([_H[0], _H[1] + _H[2], -_H[2]]).ravel().tolist())
ASIDE = 1e-3  # fraction of a step: distance of three rates for their derivative by time
CAREFUL = 10.0  # factor on the estimate, which is closer to the error than that of Radau
SHORTEST, LONGEST, SAFETY = 0.2, 6.0, 0.9  # ratios of two steps; safety factor of the estimate
# Most reductions of a step because of a kink: stages are evaluated beyond it, with another branch of the law, which the estimate hardly shows.
MOST_BENDS = 8
POWER = 0.2  # exponent of the estimate in the step size
