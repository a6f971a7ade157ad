/* The same function called again and again, at one point: of a program (time, state, inputs, constants, mode, out), and by hand (time, state, out). */

#include <stdint.h>

typedef void (*Generated)(double, const double *, const double *, const double *, const double *, double *);
typedef void (*Written)(double, const double *, double *);

void loop_generated(Generated f, int64_t count, double t, const double *y, const double *inputs, const double *constants, const double *mode, double *out)
{
    for (int64_t i = 0; i < count; i++)
        f(t, y, inputs, constants, mode, out);
}

void loop_written(Written f, int64_t count, double t, const double *y, double *out)
{
    for (int64_t i = 0; i < count; i++)
        f(t, y, out);
}
