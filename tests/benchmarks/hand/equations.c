/* The equations of the benchmarks as somebody would write them in C by hand: rates f(t, y, dy) and the dense Jacobian J(t, y, j), by columns.
   Of `amplifier` f is what M y' equals, with the matrix in `amplifier_mass`. */

#include <math.h>
#include <string.h>

/* --- Robertson: Hairer and Wanner, Solving ODEs II, section IV.10 --- */

void robertson_f(double t, const double *y, double *dy)
{
    (void)t;
    const double a = 0.04 * y[0], b = 1e4 * y[1] * y[2], c = 3e7 * y[1] * y[1];
    dy[0] = -a + b;
    dy[1] = a - b - c;
    dy[2] = c;
}

void robertson_j(double t, const double *y, double *j)
{
    (void)t;
    j[0] = -0.04, j[1] = 0.04, j[2] = 0;
    j[3] = 1e4 * y[2], j[4] = -1e4 * y[2] - 6e7 * y[1], j[5] = 6e7 * y[1];
    j[6] = 1e4 * y[1], j[7] = -1e4 * y[1], j[8] = 0;
}

/* --- van der Pol, mu = 1000: the same, VDPOL --- */

void vdpol_f(double t, const double *y, double *dy)
{
    (void)t;
    dy[0] = y[1];
    dy[1] = 1000.0 * (1 - y[0] * y[0]) * y[1] - y[0];
}

void vdpol_j(double t, const double *y, double *j)
{
    (void)t;
    j[0] = 0, j[1] = -2000.0 * y[0] * y[1] - 1, j[2] = 1, j[3] = 1000.0 * (1 - y[0] * y[0]);
}

/* --- a lossless oscillator with a hardening spring: x'' = -(x + x^3) --- */

void duffing_f(double t, const double *y, double *dy)
{
    (void)t;
    dy[0] = y[1];
    dy[1] = -(y[0] + y[0] * y[0] * y[0]);
}

void duffing_j(double t, const double *y, double *j)
{
    (void)t;
    j[0] = 0, j[1] = -(1 + 3 * y[0] * y[0]), j[2] = 1, j[3] = 0;
}

/* --- the transistor amplifier: the same, section VI.1; M y' = f, 8 node voltages --- */

enum { NODES = 8 };
static const double UB = 6, UF = 0.026, ALPHA = 0.99, BETA = 1e-6, R0 = 1000, R = 9000;

const double amplifier_mass[NODES * NODES] = { /* by columns */
    -1e-6, 1e-6, 0, 0, 0, 0, 0, 0, 1e-6, -1e-6, 0, 0, 0, 0, 0, 0,
    0, 0, -2e-6, 0, 0, 0, 0, 0, 0, 0, 0, -3e-6, 3e-6, 0, 0, 0,
    0, 0, 0, 3e-6, -3e-6, 0, 0, 0, 0, 0, 0, 0, 0, -4e-6, 0, 0,
    0, 0, 0, 0, 0, 0, -5e-6, 5e-6, 0, 0, 0, 0, 0, 0, 5e-6, -5e-6,
};

void amplifier_f(double t, const double *y, double *f)
{
    const double ue = 0.1 * sin(200 * M_PI * t);
    const double g1 = BETA * (exp((y[1] - y[2]) / UF) - 1), g2 = BETA * (exp((y[4] - y[5]) / UF) - 1);
    f[0] = (y[0] - ue) / R0;
    f[1] = y[1] / R + (y[1] - UB) / R + (1 - ALPHA) * g1;
    f[2] = y[2] / R - g1;
    f[3] = (y[3] - UB) / R + ALPHA * g1;
    f[4] = y[4] / R + (y[4] - UB) / R + (1 - ALPHA) * g2;
    f[5] = y[5] / R - g2;
    f[6] = (y[6] - UB) / R + ALPHA * g2;
    f[7] = y[7] / R;
}

void amplifier_j(double t, const double *y, double *j)
{
    (void)t;
    const double d1 = BETA / UF * exp((y[1] - y[2]) / UF), d2 = BETA / UF * exp((y[4] - y[5]) / UF);
    memset(j, 0, NODES * NODES * sizeof *j);
#define J(r, c) j[(c) * NODES + (r)]
    J(0, 0) = 1 / R0;
    J(1, 1) = 2 / R + (1 - ALPHA) * d1, J(1, 2) = -(1 - ALPHA) * d1;
    J(2, 1) = -d1, J(2, 2) = 1 / R + d1;
    J(3, 1) = ALPHA * d1, J(3, 2) = -ALPHA * d1, J(3, 3) = 1 / R;
    J(4, 4) = 2 / R + (1 - ALPHA) * d2, J(4, 5) = -(1 - ALPHA) * d2;
    J(5, 4) = -d2, J(5, 5) = 1 / R + d2;
    J(6, 4) = ALPHA * d2, J(6, 5) = -ALPHA * d2, J(6, 6) = 1 / R;
    J(7, 7) = 1 / R;
#undef J
}

/* --- the manipulator: three shuttles c, a platform x, y, phi; energies of the flexures in the frame turned by half the angle --- */

static const double H = 38e-6, LS = 1e-3, LF = 400e-6, P = 0.72, A = 170e-6, S = 0.5e-3, DAMPING = 2.5e-5, DENSITY = 2330;
static const double D[3] = {1.95e-6, 1.75e-6, 1.75e-6}, E[3] = {130e9, 158e9, 158e9};
static const double COS[3] = {1, -0.5, -0.5}, SIN[3] = {0, 0.86602540378443864676, -0.86602540378443864676};
static double k_phi[3], k_x[3], k_y[3], k_g[3], mass[6], damping[6];

void manipulator_begin(void)
{
    for (int i = 0; i < 3; i++) {
        const double moment = H * D[i] * D[i] * D[i] / 12, area = H * D[i];
        k_phi[i] = E[i] * moment / LS / (1 - P);
        k_x[i] = 12 * E[i] * moment / (LS * LS * LS) / (1 - P * P * P);
        k_y[i] = E[i] * area / LS / (1 - P);
        k_g[i] = 48 * E[i] * moment / (LF * LF * LF);
        mass[i] = 39.8e-9 + DENSITY * H * (14e-6 * 720e-6 * (14.0 * 14 - 9 * 9) / (14 * 14) + 2e-6 * 280e-6);
        damping[i] = DAMPING, damping[i + 3] = 0;
    }
    mass[3] = mass[4] = 378 * DENSITY * 12e-6 * 12e-6 * H * 0.4375, mass[5] = 2.94e-17;
}

static double push(double t)
{
    const double s = t / 5e-3;
    return t <= 0 ? 0 : t >= 5e-3 ? 30e-6 : 30e-6 * s * s * s * (10 - 15 * s + 6 * s * s);
}

void manipulator_f(double t, const double *z, double *dz)
{
    const double cosine = cos(z[5]), sine = sin(z[5]), ch = cos(z[5] / 2), sh = sin(z[5] / 2), versine = 2 * sh * sh;
    const double over_x = S * cosine - A * sine, over_y = A * cosine + S * sine, at_x = S * sine - A * versine, at_y = A * sine + S * versine;
    double fx = push(t), fy = 0, m = 0;
    for (int i = 0; i < 3; i++) {
        const double xa = z[3] * COS[i] + z[4] * SIN[i] + at_x, ya = z[4] * COS[i] - z[3] * SIN[i] + at_y - z[i];
        const double xc = xa * ch + ya * sh, yc = ya * ch - xa * sh;
        const double px = k_x[i] * xc, py = k_y[i] * yc, force_x = px * ch - py * sh, force_y = px * sh + py * ch;
        dz[i] = z[6 + i];
        dz[6 + i] = (force_y - k_g[i] * z[i] - DAMPING * z[6 + i]) / mass[i];
        fx -= force_x * COS[i] - force_y * SIN[i];
        fy -= force_x * SIN[i] + force_y * COS[i];
        m -= k_phi[i] * z[5] + (k_x[i] - k_y[i]) * xc * yc / 2 + force_x * over_x + force_y * over_y;
    }
    dz[3] = z[9], dz[4] = z[10], dz[5] = z[11];
    dz[9] = fx / mass[3], dz[10] = fy / mass[4], dz[11] = m / mass[5];
}

void manipulator_j(double t, const double *z, double *j)
{
    (void)t;
    const double cosine = cos(z[5]), sine = sin(z[5]), ch = cos(z[5] / 2), sh = sin(z[5] / 2), versine = 2 * sh * sh;
    const double over_x = S * cosine - A * sine, over_y = A * cosine + S * sine, at_x = S * sine - A * versine, at_y = A * sine + S * versine;
    double xx = 0, xy = 0, yy = 0, xp = 0, yp = 0, pp = 0;
    memset(j, 0, 144 * sizeof *j);
#define J(r, c) j[(c) * 12 + (r)]
    for (int i = 0; i < 6; i++)
        J(i, 6 + i) = 1, J(6 + i, 6 + i) = -damping[i] / mass[i];
    for (int i = 0; i < 3; i++) {
        const double xa = z[3] * COS[i] + z[4] * SIN[i] + at_x, ya = z[4] * COS[i] - z[3] * SIN[i] + at_y - z[i];
        const double xc = xa * ch + ya * sh, yc = ya * ch - xa * sh, k = k_x[i] - k_y[i];
        const double px = k_x[i] * xc, py = k_y[i] * yc, force_x = px * ch - py * sh, force_y = px * sh + py * ch;
        /* second derivatives over xa, ya and the angle */
        const double aa = k_x[i] * ch * ch + k_y[i] * sh * sh, bb = k_x[i] * sh * sh + k_y[i] * ch * ch, ab = k * sh * ch;
        const double ap = k * (ch * yc - sh * xc) / 2, bp = k * (sh * yc + ch * xc) / 2, qq = k_phi[i] + k * (yc * yc - xc * xc) / 4;
        /* the force along y by x, y, phi of the platform */
        const double bx = ab * COS[i] - bb * SIN[i], by = ab * SIN[i] + bb * COS[i], bphi = ab * over_x + bb * over_y + bp;
        const double ax = aa * COS[i] - ab * SIN[i], ay = aa * SIN[i] + ab * COS[i], aphi = aa * over_x + ab * over_y + ap;
        J(6 + i, i) = -(bb + k_g[i]) / mass[i];
        J(6 + i, 3) = bx / mass[i], J(6 + i, 4) = by / mass[i], J(6 + i, 5) = bphi / mass[i];
        J(9, i) = bx / mass[3], J(10, i) = by / mass[4], J(11, i) = bphi / mass[5];
        xx += ax * COS[i] - bx * SIN[i], xy += ax * SIN[i] + bx * COS[i], yy += ay * SIN[i] + by * COS[i];
        xp += aphi * COS[i] - bphi * SIN[i], yp += aphi * SIN[i] + bphi * COS[i];
        pp += aphi * over_x + bphi * over_y + (ap * over_x + bp * over_y + qq) + force_x * (-A * cosine - S * sine) + force_y * (S * cosine - A * sine);
    }
    J(9, 3) = -xx / mass[3], J(9, 4) = -xy / mass[3], J(9, 5) = -xp / mass[3];
    J(10, 3) = -xy / mass[4], J(10, 4) = -yy / mass[4], J(10, 5) = -yp / mass[4];
    J(11, 3) = -xp / mass[5], J(11, 4) = -yp / mass[5], J(11, 5) = -pp / mass[5];
#undef J
}
