/* RC networks with cubic leaks, written by hand: SUNDIALS' CVODE (BDF) with KLU.

   Built and run by bench_large_models.py. Reads from stdin: rtol, end, instants, nodes, edges, then each edge (a b ohm) and each start;
   prints seconds of solving, steps, evaluations, factorisations, nonzeros in the factors, then both reported voltages at every instant. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <time.h>

static const double FEED = 1.0 / 10.0, C = 1e-6, LINEAR = 1e-4, CUBIC = 1e-3;
static int nodes, edges, *ends, *slot; /* slot: four places of each edge, then one of each node, in the matrix */
static double *conductance;
static sunindextype *starts, *rows, count;

static int rates(realtype t, N_Vector y, N_Vector out, void *data) {
    const double *u = N_VGetArrayPointer(y);
    double *f = N_VGetArrayPointer(out);
    for (int i = 0; i < nodes; i++) f[i] = -(LINEAR * u[i] + CUBIC * u[i] * u[i] * u[i]);
    f[0] += FEED * (sin(2 * M_PI * 1000 * t) - u[0]);
    for (int k = 0; k < edges; k++) {
        double i = conductance[k] * (u[ends[2 * k]] - u[ends[2 * k + 1]]);
        f[ends[2 * k]] -= i;
        f[ends[2 * k + 1]] += i;
    }
    for (int i = 0; i < nodes; i++) f[i] /= C;
    return 0;
}

static int jacobian(realtype t, N_Vector y, N_Vector fy, SUNMatrix j, void *data, N_Vector a, N_Vector b, N_Vector c) {
    const double *u = N_VGetArrayPointer(y);
    SUNMatZero(j);
    double *x = SUNSparseMatrix_Data(j);
    sunindextype *p = SUNSparseMatrix_IndexPointers(j), *r = SUNSparseMatrix_IndexValues(j);
    for (int i = 0; i <= nodes; i++) p[i] = starts[i];
    for (int i = 0; i < count; i++) r[i] = rows[i], x[i] = 0;
    for (int i = 0; i < nodes; i++) x[slot[4 * edges + i]] -= (LINEAR + 3 * CUBIC * u[i] * u[i]) / C;
    x[slot[4 * edges]] -= FEED / C;
    for (int k = 0; k < edges; k++) {
        double g = conductance[k] / C;
        x[slot[4 * k]] -= g;
        x[slot[4 * k + 1]] += g;
        x[slot[4 * k + 2]] += g;
        x[slot[4 * k + 3]] -= g;
    }
    return 0;
}

static int place(int row, int column) {
    for (sunindextype k = starts[column]; k < starts[column + 1]; k++)
        if (rows[k] == row) return (int)k;
    abort();
}

static int by_number(const void *a, const void *b) {
    long long d = *(const long long *)a - *(const long long *)b;
    return d < 0 ? -1 : d > 0;
}

static void pattern(void) {
    long long *keys = malloc(sizeof *keys * (4 * edges + nodes));
    long n = 0;
    for (int k = 0; k < edges; k++)
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++) keys[n++] = (long long)ends[2 * k + j] * nodes + ends[2 * k + i];
    for (int i = 0; i < nodes; i++) keys[n++] = (long long)i * nodes + i;
    qsort(keys, n, sizeof *keys, by_number);
    starts = calloc(nodes + 1, sizeof *starts);
    rows = malloc(sizeof *rows * n);
    for (long i = 0; i < n; i++)
        if (i == 0 || keys[i] != keys[i - 1]) {
            rows[count++] = keys[i] % nodes;
            starts[keys[i] / nodes + 1] = count;
        }
    for (int i = 0; i < nodes; i++)
        if (starts[i + 1] < starts[i]) starts[i + 1] = starts[i];
    slot = malloc(sizeof *slot * (4 * edges + nodes));
    for (int k = 0; k < edges; k++) {
        int a = ends[2 * k], b = ends[2 * k + 1];
        slot[4 * k] = place(a, a), slot[4 * k + 1] = place(a, b), slot[4 * k + 2] = place(b, a), slot[4 * k + 3] = place(b, b);
    }
    for (int i = 0; i < nodes; i++) slot[4 * edges + i] = place(i, i);
    free(keys);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(void) {
    double rtol, end;
    int instants;
    if (scanf("%lf %lf %d %d %d", &rtol, &end, &instants, &nodes, &edges) != 5) return 1;
    ends = malloc(sizeof *ends * 2 * edges);
    conductance = malloc(sizeof *conductance * edges);
    for (int k = 0; k < edges; k++) {
        double ohm;
        if (scanf("%d %d %lf", &ends[2 * k], &ends[2 * k + 1], &ohm) != 3) return 1;
        ends[2 * k]--, ends[2 * k + 1]--;
        conductance[k] = 1 / ohm;
    }
    int first, last;
    if (scanf("%d %d", &first, &last) != 2) return 1;
    SUNContext context;
    SUNContext_Create(NULL, &context);
    N_Vector y = N_VNew_Serial(nodes, context);
    for (int i = 0; i < nodes; i++)
        if (scanf("%lf", N_VGetArrayPointer(y) + i) != 1) return 1;
    double *told = malloc(sizeof *told * 2 * instants), began = now();
    pattern();
    void *solver = CVodeCreate(CV_BDF, context);
    CVodeInit(solver, rates, 0, y);
    CVodeSStolerances(solver, rtol, rtol);
    CVodeSetMaxNumSteps(solver, 1000000);
    SUNMatrix matrix = SUNSparseMatrix(nodes, nodes, count, CSC_MAT, context);
    SUNLinearSolver linear = SUNLinSol_KLU(y, matrix, context);
    SUNLinSol_KLUSetOrdering(linear, 0); /* AMD: less fill here than COLAMD */
    CVodeSetLinearSolver(solver, linear, matrix);
    CVodeSetJacFn(solver, jacobian);
    told[0] = N_VGetArrayPointer(y)[first - 1], told[1] = N_VGetArrayPointer(y)[last - 1];
    for (int i = 1; i < instants; i++) {
        realtype t;
        if (CVode(solver, end * i / (instants - 1), y, &t, CV_NORMAL) < 0) return 2;
        told[2 * i] = N_VGetArrayPointer(y)[first - 1], told[2 * i + 1] = N_VGetArrayPointer(y)[last - 1];
    }
    double took = now() - began;
    long steps, evaluations, setups;
    CVodeGetNumSteps(solver, &steps);
    CVodeGetNumRhsEvals(solver, &evaluations);
    CVodeGetNumLinSolvSetups(solver, &setups);
    sun_klu_numeric *numeric = SUNLinSol_KLUGetNumeric(linear);
    printf("%.9g %ld %ld %ld %ld\n", took, steps, evaluations, setups, (long)(numeric->lnz + numeric->unz));
    for (int i = 0; i < instants; i++) printf("%.17g %.17g\n", told[2 * i], told[2 * i + 1]);
    return 0;
}
