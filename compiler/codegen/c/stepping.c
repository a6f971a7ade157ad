/* ------------------------------------------------------------------ stepping
   struct NAME_model model; struct NAME_inputs in; struct NAME_outputs out;
   NAME_defaults_of(&in); status = NAME_init(&model, NAME_defaults, step); then status = NAME_step(&model, &in, &out) again and again:
   it takes the inputs of the instant k*step, lets act what is due, gives the outputs of that instant and goes on to the next.
   Samples act at their own instants, also within a step. A condition that changes and changes back within a step is not seen: take a shorter one. */

struct NAME_inputs {
@input_fields@
};
struct NAME_outputs {
@output_fields@
};
enum {
@sizes@
    NAME_cuts = 1000, /* most events within a step */
    NAME_rounds = 100, /* most events that cause each other at an instant */
    NAME_halvings = 60
};
/* What a function returns: events without end within a step, among them a law that jumps and on whose jump the motion stays (dry friction
   under a load: give it a mode that sticks, or a smooth law), or at an instant; two events that set one thing at an instant; a limit of the
   model that does not hold; a step, period, offset, delay or jitter out of its range; a state or output that is no finite number, as where the
   step is too long for the fastest mode; parameters with which the model has no meaning (@checks@). */
enum { NAME_fine = 0, NAME_piled_up, NAME_without_end, NAME_set_twice, NAME_beyond_limit, NAME_wrong_time, NAME_not_finite, NAME_no_model };

struct NAME_model {
    double step, time, count; /* the instant is count*step */
    double constants[NAME_constants_count + 1];
    double inputs[NAME_n_inputs + 1];
    double state[NAME_n_states + 1];
    double mode[NAME_n_modes + 1];
    double sampling[5 * NAME_n_samples + 1]; /* of each: period, offset, delay, jitter, seed */
    double number[NAME_n_samples + 1]; /* of the next tick */
    double acted[NAME_n_events + 1]; /* when each event acted last and made its condition false; before the run: never */
    int was_true[NAME_n_events + 1];
    double rest[NAME_n_conditions + 1]; /* the two sides of each condition count as equal up to this: there the model rests */
};

@lists@

@nothing@static double NAME_tick(const struct NAME_model *model, int sample)
{
    const double *row = model->sampling + 5 * sample;
    const double number = model->number[sample];
    double late = row[1] + row[2];
    if (row[3] > 0.0) {
        late = late + row[3] * (0.5 + 0.5 * random_number((int64_t)number, (int64_t)row[4]));
    }
    return row[0] * number + late;
}

/* Instants closer than this are one. */
static double NAME_close(const struct NAME_model *model, int sample)
{
    return 16.0 * ulp(greatest(fabs(model->time), model->sampling[5 * sample]));
}

/* One pass over the conditions: the mode with the truth of those on time `now`, and of those on states at a time. */
static void NAME_look(const struct NAME_model *model, double now, double time, const double *state, double *mode)
{
    double truth[NAME_n_timed + 1] = {0}, root[NAME_n_conditions + 1] = {0}, count[NAME_n_counts + 1] = {0};
    int i;
    for (i = 0; i < NAME_n_modes; i++) {
        mode[i] = model->mode[i];
    }
    NAME_switches(now, state, model->inputs, model->constants, model->mode, truth);
    for (i = 0; i < NAME_n_timed; i++) {
        mode[NAME_timed[i]] = truth[i];
    }
    @roots@(time, state, model->inputs, model->constants, model->mode, root);
    for (i = 0; i < NAME_n_conditions; i++) {
        mode[NAME_places[i]] = (NAME_strict[i] ? root[i] < -model->rest[i] : root[i] <= model->rest[i]) ? 1.0 : 0.0;
    }
    @counts@(time, state, model->inputs, model->constants, mode, count);
    for (i = 0; i < NAME_n_counts; i++) {
        mode[NAME_counted[i]] = count[i];
    }
}

static int NAME_differs(const double *a, const double *b, int count)
{
    int i, differs = 0;
    for (i = 0; i < count; i++) {
        differs |= a[i] < b[i] || a[i] > b[i];
    }
    return differs;
}

/* The state so much later, by the classical method of Runge and Kutta. */
static void NAME_runge_kutta(const struct NAME_model *model, double h, double *state)
{
    static const double weights[4] = {1.0, 2.0, 2.0, 1.0}, shares[4] = {0.0, 0.5, 0.5, 1.0};
    double rate[NAME_n_states + 1] = {0}, at[NAME_n_states + 1] = {0};
    int i, stage;
    for (i = 0; i < NAME_n_states; i++) {
        state[i] = model->state[i];
        rate[i] = 0.0;
    }
    for (stage = 0; stage < 4; stage++) {
        for (i = 0; i < NAME_n_states; i++) {
            at[i] = model->state[i] + shares[stage] * h * rate[i];
        }
        NAME_derivative(model->time + shares[stage] * h, at, model->inputs, model->constants, model->mode, rate);
        for (i = 0; i < NAME_n_states; i++) {
            state[i] = state[i] + h / 6.0 * weights[stage] * rate[i];
        }
    }
}

/* Each of these conditions leads back from both its sides, as dry friction does: rest between them, if nothing else moves the model from there. */
static void NAME_stand(struct NAME_model *model, const int *flips, double ahead)
{
    double before[NAME_n_conditions + 1] = {0}, after[NAME_n_conditions + 1] = {0}, state[NAME_n_states + 1] = {0};
    double mode[NAME_n_modes + 1] = {0}, moved[NAME_n_conditions + 1] = {0};
    int i, stands = 1;
    NAME_runge_kutta(model, ahead, state);
    @roots@(model->time, model->state, model->inputs, model->constants, model->mode, before);
    @roots@(model->time + ahead, state, model->inputs, model->constants, model->mode, after);
    for (i = 0; i < NAME_n_conditions; i++) {
        moved[i] = flips[i] ? fabs(after[i] - before[i]) : 0.0;
    }
    for (i = 0; i < NAME_n_modes; i++) {
        mode[i] = model->mode[i];
    }
    for (i = 0; i < NAME_n_conditions; i++) {
        model->mode[NAME_places[i]] = flips[i] ? (NAME_strict[i] ? 0.0 : 1.0) : mode[NAME_places[i]];
    }
    NAME_runge_kutta(model, ahead, state);
    @roots@(model->time, model->state, model->inputs, model->constants, model->mode, before);
    @roots@(model->time + ahead, state, model->inputs, model->constants, model->mode, after);
    for (i = 0; i < NAME_n_conditions; i++) {
        stands &= !flips[i] || (fabs(before[i]) <= moved[i] && fabs(after[i] - before[i]) <= 1e-6 * moved[i]);
    }
    for (i = 0; i < NAME_n_conditions && stands; i++) {
        model->rest[i] = flips[i] ? moved[i] : model->rest[i];
    }
    for (i = 0; i < NAME_n_modes && !stands; i++) {
        model->mode[i] = mode[i];
    }
}

/* The conditions as they are just after: one may read another. */
static void NAME_settle(struct NAME_model *model)
{
    const double ahead = @ahead@;
    double mode[NAME_n_modes + 1] = {0}, state[NAME_n_states + 1] = {0};
    int flips[NAME_n_conditions + 1] = {0};
    int i, round, differs = 1, leaves = 0;
    for (round = 0; round <= NAME_n_modes + 1 && differs; round++) {
        NAME_runge_kutta(model, ahead, state);
        NAME_look(model, model->time, model->time + ahead, state, mode);
        differs = NAME_differs(mode, model->mode, NAME_n_modes);
        for (i = 0; i < NAME_n_conditions; i++) {
            flips[i] = NAME_differs(mode + NAME_places[i], model->mode + NAME_places[i], 1);
            leaves |= flips[i] && model->rest[i] > 0.0;
        }
        for (i = 0; i < NAME_n_conditions && leaves; i++) {
            model->rest[i] = 0.0;
        }
        for (i = 0; i < NAME_n_modes; i++) {
            model->mode[i] = mode[i];
        }
    }
    if (differs) {
        NAME_stand(model, flips, ahead);
    }
}

/* Whether each condition that rates, outputs, events or other conditions read has a value. */
static int NAME_compares(struct NAME_model *model)
{
    double root[NAME_n_conditions + 1] = {0}, roots[2][NAME_n_conditions + 1] = {{0}}, rate[2][NAME_n_states + 1] = {{0}};
    double value[2][NAME_n_outputs + 1] = {{0}}, truth[2][NAME_n_events + 1] = {{0}};
    int i, k, fine = 1;
    @roots@(model->time, model->state, model->inputs, model->constants, model->mode, root);
    for (i = 0; i < NAME_n_conditions; i++) {
        for (k = 0; k < 2 && isnan(root[i]); k++) {
            model->mode[NAME_places[i]] = 1.0 - model->mode[NAME_places[i]];
            NAME_derivative(model->time, model->state, model->inputs, model->constants, model->mode, rate[k]);
            NAME_output(model->time, model->state, model->inputs, model->constants, model->mode, value[k]);
            @triggers@(model->time, model->state, model->inputs, model->constants, model->mode, truth[k]);
            @roots@(model->time, model->state, model->inputs, model->constants, model->mode, roots[k]);
        }
        fine &= !isnan(root[i]) || !(NAME_differs(rate[0], rate[1], NAME_n_states) || NAME_differs(value[0], value[1], NAME_n_outputs)
            || NAME_differs(truth[0], truth[1], NAME_n_events) || NAME_differs(roots[0], roots[1], NAME_n_conditions));
    }
    return fine;
}

/* What the events that act set, all from the values before; `late`: of blocks whose delay is zero, after the others. */
static int NAME_set(struct NAME_model *model, const int *acts)
{
    double value[NAME_n_settings + 1] = {0};
    int i, j, twice = 0;
    @values@(model->time, model->state, model->inputs, model->constants, model->mode, value);
    for (i = 0; i < NAME_n_settings; i++) {
        if (acts[NAME_owner[i]]) {
            for (j = 0; j < i; j++) {
                twice |= acts[NAME_owner[j]] && NAME_is_mode[i] == NAME_is_mode[j] && NAME_position[i] == NAME_position[j];
            }
            if (NAME_is_mode[i]) {
                model->mode[NAME_position[i]] = value[i];
            } else {
                model->state[NAME_position[i]] = value[i];
            }
        }
    }
    return twice;
}

/* All that acts at an instant. */
static int NAME_instant(struct NAME_model *model)
{
    int first[NAME_n_events + 1] = {0}, then[NAME_n_events + 1] = {0}, due[NAME_n_events + 1] = {0};
    double truth[NAME_n_events + 1] = {0};
    int i, round, any = 1, twice = 0, piled = 0;
    for (i = 0; i <= NAME_n_events; i++) {
        due[i] = 0;
        truth[i] = 0.0;
    }
    for (i = 0; i < NAME_n_samples; i++) {
        if (NAME_tick(model, i) <= model->time + NAME_close(model, i)) {
            due[NAME_sampled[i]] = NAME_late[NAME_sampled[i]] && !(model->sampling[5 * i + 2] > 0.0) ? 2 : 1;
            model->number[i] += 1.0;
        }
    }
    NAME_settle(model);
    for (round = 0; round < NAME_rounds && any; round++) {
        any = 0;
        @triggers@(model->time, model->state, model->inputs, model->constants, model->mode, truth);
        for (i = 0; i < NAME_n_events; i++) {
            const int is_true = truth[i] > 0.5;
            first[i] = due[i] == 1 || (is_true && !model->was_true[i]);
            then[i] = due[i] == 2;
            any |= first[i] || then[i];
            model->was_true[i] = is_true;
            due[i] = 0;
        }
        if (any) {
            twice |= NAME_set(model, first);
            twice |= NAME_set(model, then);
            NAME_settle(model);
            @triggers@(model->time, model->state, model->inputs, model->constants, model->mode, truth);
            for (i = 0; i < NAME_n_events; i++) {
                if (first[i] && model->was_true[i]) { /* one that made its condition false within this step and cannot any more */
                    piled |= truth[i] > 0.5 && model->time - model->acted[i] < model->step;
                    model->acted[i] = truth[i] > 0.5 ? model->acted[i] : model->time;
                }
            }
        }
    }
    return piled ? NAME_piled_up : twice ? NAME_set_twice : any ? NAME_without_end : NAME_fine;
}

/* Steps up to an instant, cut at samples and where a condition changes: behind the change, so that it is seen. */
static int NAME_advance(struct NAME_model *model, double end)
{
    double state[NAME_n_states + 1] = {0}, mode[NAME_n_modes + 1] = {0};
    int i, cut, status = NAME_fine;
    for (cut = 0; cut < NAME_cuts && model->time < end && status == NAME_fine; cut++) {
        double target = end;
        double low = 0.0, high;
        int changes;
        for (i = 0; i < NAME_n_samples; i++) {
            const double tick = NAME_tick(model, i);
            if (tick < target - NAME_close(model, i)) {
                target = greatest(tick, model->time);
            }
        }
        high = target - model->time;
        NAME_runge_kutta(model, high, state);
        NAME_look(model, target, target, state, mode);
        changes = NAME_differs(mode, model->mode, NAME_n_modes);
        for (i = 0; i < NAME_halvings && changes; i++) {
            const double middle = 0.5 * (low + high);
            NAME_runge_kutta(model, middle, state);
            NAME_look(model, model->time + middle, model->time + middle, state, mode);
            if (NAME_differs(mode, model->mode, NAME_n_modes)) {
                high = middle;
            } else {
                low = middle;
            }
        }
        if (changes) {
            NAME_runge_kutta(model, high, state);
            target = model->time + high;
        }
        for (i = 0; i < NAME_n_states; i++) {
            model->state[i] = state[i];
            status = isfinite(state[i]) ? status : NAME_not_finite;
        }
        model->time = target;
        if (target < end && status == NAME_fine) {
            status = NAME_instant(model);
        }
    }
    return status != NAME_fine ? status : model->time < end ? NAME_piled_up : NAME_fine;
}

void NAME_defaults_of(struct NAME_inputs *in)
{
@inputs_default@
}

/* Begin: parameters in the order of NAME_parameters, and the step. */
int NAME_init(struct NAME_model *model, const double *parameters, double step)
{
    double period[NAME_n_periods + 1] = {0}, holds[NAME_n_limits + 1] = {0};
    int i, k, wrong = !(step > 0.0), status = NAME_fine;
    model->step = step;
    model->time = 0.0;
    model->count = 0.0;
    NAME_constants(0, 0, 0, parameters, 0, model->constants);
    NAME_start(0, 0, 0, model->constants, 0, model->state);
    for (i = 0; i < NAME_n_modes; i++) {
        model->mode[i] = 0.0;
    }
    for (i = 0; i < NAME_n_inputs; i++) {
        model->inputs[i] = NAME_input_defaults[i];
    }
    for (i = 0; i < NAME_n_events; i++) {
        model->was_true[i] = 0;
        model->acted[i] = -2.0 * step;
    }
    for (i = 0; i < NAME_n_conditions; i++) {
        model->rest[i] = 0.0;
    }
@mode_start@
    @sampling@(0, 0, 0, model->constants, 0, model->sampling);
    for (i = 0; i < NAME_n_samples; i++) {
        const double *row = model->sampling + 5 * i;
        wrong |= !(row[0] > 0.0 && row[1] >= 0.0 && row[1] < row[0] && row[2] >= 0.0 && row[3] >= 0.0 && row[2] + row[3] < row[0]);
        model->number[i] = -2.0;
        for (k = 0; k < 3 && NAME_tick(model, i) < -NAME_close(model, i); k++) {
            model->number[i] += 1.0;
        }
    }
    NAME_periods(0, 0, 0, model->constants, 0, period);
    for (i = 0; i < NAME_n_periods; i++) {
        wrong |= !(step <= fabs(period[i]));
    }
    NAME_holds(0, model->state, model->inputs, model->constants, model->mode, holds);
    for (i = 0; NAME_checks[i] >= 0; i++) {
        status = holds[NAME_checks[i]] > 0.5 ? status : NAME_no_model;
    }
    for (i = 0; i < NAME_n_states && status == NAME_fine; i++) {
        status = isfinite(model->state[i]) ? NAME_fine : NAME_not_finite;
    }
    return wrong ? NAME_wrong_time : status;
}

/* One step: inputs of this instant, outputs of this instant, and on to the next. */
int NAME_step(struct NAME_model *model, const struct NAME_inputs *in, struct NAME_outputs *out)
{
    double value[NAME_n_outputs + 1] = {0}, holds[NAME_n_limits + 1] = {0};
    int i, status;
@inputs_in@
    status = NAME_instant(model);
    status = status == NAME_fine && !NAME_compares(model) ? NAME_not_finite : status;
    NAME_output(model->time, model->state, model->inputs, model->constants, model->mode, value);
    NAME_holds(model->time, model->state, model->inputs, model->constants, model->mode, holds);
    for (i = 0; i < NAME_n_outputs && status == NAME_fine; i++) {
        status = isfinite(value[i]) ? NAME_fine : NAME_not_finite;
    }
    for (i = 0; i < NAME_n_limits && status == NAME_fine; i++) {
        status = holds[i] > 0.5 ? NAME_fine : NAME_beyond_limit;
    }
@outputs_out@
    if (status == NAME_fine || status == NAME_beyond_limit) {
        const int after = NAME_advance(model, (model->count + 1.0) * model->step);
        status = after != NAME_fine ? after : status;
    }
    model->count += 1.0;
    model->time = model->count * model->step;
    return status;
}

#ifdef NAME_MAIN
/* A program to try it: `cc -DNAME_MAIN FILE.c -lm && ./a.out STEP END` prints the outputs at each step. */
#include <stdio.h>

int main(int count, char **words)
{
    struct NAME_model model;
    struct NAME_inputs in;
    struct NAME_outputs out;
    const double step = count > 1 ? (double)strtod(words[1], 0) : 1e-3, end = count > 2 ? (double)strtod(words[2], 0) : 1.0;
    int i, k, status, left = NAME_fine;
    NAME_defaults_of(&in);
    status = NAME_init(&model, NAME_defaults, (double)step);
    printf("time");
    for (i = 0; i < NAME_n_outputs; i++) {
        printf(",%s", NAME_outputs[i][0]);
    }
    printf("\n");
    for (k = 0; (double)k * step <= end + 0.5 * step && (status == NAME_fine || status == NAME_beyond_limit); k++) {
        status = NAME_step(&model, &in, &out);
        if (status == NAME_beyond_limit && left == NAME_fine) {
            left = status;
            fprintf(stderr, "NAME: status %d at %.9g s\n", status, (double)k * step);
        }
        printf("%.17g", (double)k * step);
    @printed@
        printf("\n");
    }
    if (status != NAME_fine && status != NAME_beyond_limit) {
        left = status;
        fprintf(stderr, "NAME: status %d at %.9g s\n", status, (double)model.time);
    }
    return left;
}
#endif
