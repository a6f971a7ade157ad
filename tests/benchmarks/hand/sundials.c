/* CVODE and IDA, of the libraries that scikit-sundae brings, over equations in C. Only what is called is declared. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef void (*Rates)(double, const double *, double *);
typedef void *Opaque;
typedef int32_t Index; /* as in the wheels */

int SUNContext_Create(int, Opaque *);
int SUNContext_Free(Opaque *);
int SUNContext_ClearErrHandlers(Opaque);
Opaque N_VNew_Serial(Index, Opaque);
double *N_VGetArrayPointer(Opaque);
void N_VDestroy(Opaque);
Opaque SUNDenseMatrix(Index, Index, Opaque);
double *SUNDenseMatrix_Data(Opaque);
void SUNMatDestroy(Opaque);
Opaque SUNLinSol_Dense(Opaque, Opaque, Opaque);
int SUNLinSolFree(Opaque);
Opaque CVodeCreate(int, Opaque);
int CVodeInit(Opaque, int (*)(double, Opaque, Opaque, void *), double, Opaque);
int CVodeReInit(Opaque, double, Opaque);
int CVodeSVtolerances(Opaque, double, Opaque);
int CVodeSetLinearSolver(Opaque, Opaque, Opaque);
int CVodeSetJacFn(Opaque, int (*)(double, Opaque, Opaque, Opaque, void *, Opaque, Opaque, Opaque));
int CVodeSetUserData(Opaque, void *);
int CVodeSetMaxOrd(Opaque, int);
int CVodeSetMaxNumSteps(Opaque, long);
int CVodeSetStopTime(Opaque, double);
int CVode(Opaque, double, Opaque, double *, int);
int CVodeGetNumSteps(Opaque, long *);
void CVodeFree(Opaque *);
Opaque IDACreate(Opaque);
int IDAInit(Opaque, int (*)(double, Opaque, Opaque, Opaque, void *), double, Opaque, Opaque);
int IDASVtolerances(Opaque, double, Opaque);
int IDASetLinearSolver(Opaque, Opaque, Opaque);
int IDASetJacFn(Opaque, int (*)(double, double, Opaque, Opaque, Opaque, Opaque, void *, Opaque, Opaque, Opaque));
int IDASetUserData(Opaque, void *);
int IDASetMaxOrd(Opaque, int);
int IDASetMaxNumSteps(Opaque, long);
int IDASolve(Opaque, double, double *, Opaque, Opaque, int);
int IDAGetNumSteps(Opaque, long *);
int IDASetId(Opaque, Opaque);
void IDAFree(Opaque *);

typedef struct {
    Rates f, j;
    const double *mass;
    int n;
} Problem;

static double clock_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int rates(double t, Opaque y, Opaque dy, void *user)
{
    ((Problem *)user)->f(t, N_VGetArrayPointer(y), N_VGetArrayPointer(dy));
    return 0;
}

static int jacobian(double t, Opaque y, Opaque dy, Opaque matrix, void *user, Opaque a, Opaque b, Opaque c)
{
    (void)dy, (void)a, (void)b, (void)c;
    ((Problem *)user)->j(t, N_VGetArrayPointer(y), SUNDenseMatrix_Data(matrix));
    return 0;
}

static int residual(double t, Opaque y, Opaque dy, Opaque r, void *user)
{
    const Problem *p = user;
    const double *slope = N_VGetArrayPointer(dy);
    double *rest = N_VGetArrayPointer(r);
    p->f(t, N_VGetArrayPointer(y), rest);
    for (int c = 0; c < p->n; c++)
        for (int k = 0; k < p->n; k++)
            rest[k] -= p->mass[c * p->n + k] * slope[c];
    return 0;
}

static int shifted(double t, double shift, Opaque y, Opaque dy, Opaque r, Opaque matrix, void *user, Opaque a, Opaque b, Opaque c)
{
    const Problem *p = user;
    (void)dy, (void)r, (void)a, (void)b, (void)c;
    double *m = SUNDenseMatrix_Data(matrix);
    p->j(t, N_VGetArrayPointer(y), m);
    for (int k = 0; k < p->n * p->n; k++)
        m[k] -= shift * p->mass[k];
    return 0;
}

enum { MORE_STEPS = -1, AT_ONCE = 20000 };

/* States at `times` (the first is the start) into `out`, beginning anew at `stops`. -> seconds; steps; 0 if all went well, 1 if it was given up. */
double run_cvode(Rates f, Rates j, int n, int order, double rtol, const double *atol, const double *start, int count, const double *times,
                 int stop_count, const double *stops, double patience, double *out, long *steps, int *failed)
{
    const double began = clock_now();
    Opaque context = 0, memory;
    double t = times[0];
    int next = 0;
    long passed = 0;
    *steps = 0, *failed = 1;
    if (SUNContext_Create(0, &context))
        return 0;
    SUNContext_ClearErrHandlers(context);
    Opaque y = N_VNew_Serial(n, context), tolerance = N_VNew_Serial(n, context), matrix = SUNDenseMatrix(n, n, context), solver = SUNLinSol_Dense(y, matrix, context);
    memcpy(N_VGetArrayPointer(y), start, sizeof(double[n]));
    memcpy(N_VGetArrayPointer(tolerance), atol, sizeof(double[n]));
    memcpy(out, start, sizeof(double[n]));
    Problem problem = {f, j, 0, n};
    memory = CVodeCreate(2, context);
    CVodeInit(memory, rates, t, y), CVodeSVtolerances(memory, rtol, tolerance), CVodeSetLinearSolver(memory, solver, matrix);
    CVodeSetJacFn(memory, jacobian), CVodeSetUserData(memory, &problem), CVodeSetMaxOrd(memory, order), CVodeSetMaxNumSteps(memory, AT_ONCE);
    for (int i = 1; i < count;) {
        const int stopping = next < stop_count && stops[next] <= times[i];
        const double wanted = stopping ? stops[next] : times[i];
        if (next < stop_count)
            CVodeSetStopTime(memory, stops[next]);
        const int answer = CVode(memory, wanted, y, &t, 1);
        if (answer < 0 && answer != MORE_STEPS)
            goto done;
        if (clock_now() - began > patience)
            goto done;
        if (answer == MORE_STEPS)
            continue;
        if (t == times[i])
            memcpy(out + (size_t)n * i++, N_VGetArrayPointer(y), sizeof(double[n]));
        if (stopping) {
            CVodeGetNumSteps(memory, &passed);
            *steps += passed;
            CVodeReInit(memory, t, y);
            next++;
        }
    }
    *failed = 0;
done:
    CVodeGetNumSteps(memory, &passed);
    *steps += passed;
    CVodeFree(&memory), SUNLinSolFree(solver), SUNMatDestroy(matrix), N_VDestroy(y), N_VDestroy(tolerance), SUNContext_Free(&context);
    return clock_now() - began;
}

/* The same for M y' = f. `id`: 1 where a component is differential. */
double run_ida(Rates f, Rates j, const double *mass, const double *id, int n, int order, double rtol, const double *atol, const double *start, const double *slope,
               int count, const double *times, double patience, double *out, long *steps, int *failed)
{
    const double began = clock_now();
    Opaque context = 0, memory;
    double t = times[0];
    *steps = 0, *failed = 1;
    if (SUNContext_Create(0, &context))
        return 0;
    SUNContext_ClearErrHandlers(context);
    Opaque y = N_VNew_Serial(n, context), dy = N_VNew_Serial(n, context), tolerance = N_VNew_Serial(n, context), kinds = N_VNew_Serial(n, context);
    Opaque matrix = SUNDenseMatrix(n, n, context), solver = SUNLinSol_Dense(y, matrix, context);
    memcpy(N_VGetArrayPointer(y), start, sizeof(double[n]));
    memcpy(N_VGetArrayPointer(dy), slope, sizeof(double[n]));
    memcpy(N_VGetArrayPointer(tolerance), atol, sizeof(double[n]));
    memcpy(N_VGetArrayPointer(kinds), id, sizeof(double[n]));
    memcpy(out, start, sizeof(double[n]));
    Problem problem = {f, j, mass, n};
    memory = IDACreate(context);
    IDAInit(memory, residual, t, y, dy), IDASVtolerances(memory, rtol, tolerance), IDASetLinearSolver(memory, solver, matrix), IDASetJacFn(memory, shifted);
    IDASetUserData(memory, &problem), IDASetMaxOrd(memory, order), IDASetMaxNumSteps(memory, AT_ONCE), IDASetId(memory, kinds);
    for (int i = 1; i < count;) {
        const int answer = IDASolve(memory, times[i], &t, y, dy, 1);
        if ((answer < 0 && answer != MORE_STEPS) || clock_now() - began > patience)
            goto done;
        if (answer != MORE_STEPS)
            memcpy(out + (size_t)n * i++, N_VGetArrayPointer(y), sizeof(double[n]));
    }
    *failed = 0;
done:
    IDAGetNumSteps(memory, steps);
    IDAFree(&memory), SUNLinSolFree(solver), SUNMatDestroy(matrix), N_VDestroy(y), N_VDestroy(dy), N_VDestroy(tolerance), N_VDestroy(kinds);
    SUNContext_Free(&context);
    return clock_now() - began;
}
