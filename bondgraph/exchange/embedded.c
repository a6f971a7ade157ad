/* ------------------------------------------------------------------ steps of variable size
   static struct NAME_model model; struct NAME_inputs in; struct NAME_outputs out;
   NAME_defaults_of(&in); status = NAME_init(&model, NAME_defaults, &in, start, stop, tolerance);
   then status = NAME_go(&model, &in, until) again and again: it takes the inputs, and makes the steps that the relative tolerance asks for. They may
   go beyond `until` as long as the inputs stay, but not beyond `stop`. NAME_outputs_of(&model, &out) gives the outputs of that instant.
   The methods, the events and the numbers are those of a run. Nothing is allocated or global; a copy of `model` is of use at its own address alone. */
#include <float.h>
#include <string.h>

_Static_assert(sizeof(struct FmuInstance) == 8 * @fields@, "the words of a model are not the fields of its records");
_Static_assert(DBL_MANT_DIG == 53, "steps of variable size need a double of 64 bits");
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
_Static_assert(sizeof(void *) == 8, "addresses of less than 64 bits have to begin with their lowest byte");
#endif

struct NAME_inputs {
@input_fields@
};
struct NAME_outputs {
@output_fields@
};
enum { NAME_words = @words@, NAME_n_inputs = @inputs@, NAME_n_outputs = @outputs@, NAME_n_parameters = @parameters@ };
/* What a function returns. Beyond a limit (a requirement does not hold any more) and at the end (`stop when`) all values are good; without a step
   the values are those before, and shorter ways may be tried; after a failure the model has to be initialized. */
enum { NAME_fine = 0, NAME_beyond_limit, NAME_no_step, NAME_failed, NAME_ended };

struct NAME_model {
    int64_t own[NAME_words];
};

static const int64_t NAME_image[] = {
@image@
};
static const int64_t NAME_inside[] = {
@inside@
};
static const char *const NAME_messages[] = {
@messages@
};

/* Lay out a model: its first words, zeros, the addresses of its parts and of the functions above. */
static void NAME_lay_out(int64_t *own)
{
    size_t k;
    memset(own, 0, sizeof(int64_t) * NAME_words);
    memcpy(own, NAME_image, sizeof(NAME_image));
    for (k = 0; k < sizeof(NAME_inside) / sizeof(NAME_inside[0]); k++) {
        own[NAME_inside[k]] += (int64_t)(intptr_t)own;
    }
@functions@
    own[@makes_steps@] = 1;
}

/* The compiler is not to see what it does, since its words are read as numbers and addresses later. */
static void (*const volatile NAME_lay)(int64_t *) = NAME_lay_out;

static int NAME_told(const struct NAME_model *model, int64_t answer)
{
    return answer == NAME_no_step && model->own[@message@] == @ended@ ? NAME_ended : (int)answer;
}

/* A sentence on what the last function has returned. */
const char *NAME_message(const struct NAME_model *model)
{
    return NAME_messages[model->own[@message@]];
}

void NAME_defaults_of(struct NAME_inputs *in)
{
@inputs_default@
}

static int64_t NAME_take(void *own, const struct NAME_inputs *in)
{
    double value[NAME_n_inputs + 1] = {0};
    int32_t place[NAME_n_inputs + 1] = {0};
    int32_t i;
@inputs_in@
    for (i = 0; i < NAME_n_inputs; i++) {
        place[i] = @first_input@ + i;
    }
    return set_values(own, place, NAME_n_inputs, value);
}

/* Begin at a time. Parameters are those of the table, in SI; one that says which constraints take part keeps its value. */
int NAME_init(struct NAME_model *model, const double *parameters, const struct NAME_inputs *in, double start, double stop, double tolerance)
{
    void *own = model->own;
    int64_t answer;
    int32_t i;
    NAME_lay(model->own);
    answer = set_up_and_start(own, 1, tolerance, start, stop > start, stop);
    for (i = 0; i < NAME_n_parameters && answer == 0; i++) {
        const int32_t place = @first_parameter@ + i;
        double value = 0;
        answer = get_values(own, &place, 1, &value);
        if (answer == 0 && (value < parameters[i] || value > parameters[i] || isnan(parameters[i]))) {
            answer = set_values(own, &place, 1, parameters + i);
        }
    }
    answer = answer != 0 ? answer : NAME_take(own, in);
    return NAME_told(model, answer != 0 ? answer : end_initialization(own));
}

/* The time that the model has reached. */
double NAME_time(struct NAME_model *model)
{
    const int32_t place = 0;
    double value = 0;
    (void)get_values((void *)model->own, &place, 1, &value);
    return value;
}

/* Take the inputs, and go to a time. */
int NAME_go(struct NAME_model *model, const struct NAME_inputs *in, double until)
{
    void *own = model->own;
    const double time = NAME_time(model);
    int64_t answer;
    model->own[@message@] = 0;
    answer = NAME_take(own, in);
    return NAME_told(model, answer != 0 ? answer : do_step(own, time, until - time));
}

int NAME_outputs_of(struct NAME_model *model, struct NAME_outputs *out)
{
    double value[NAME_n_outputs + 1] = {0};
    int32_t place[NAME_n_outputs + 1] = {0};
    int64_t answer;
    int32_t i;
    for (i = 0; i < NAME_n_outputs; i++) {
        place[i] = @first_output@ + i;
    }
    answer = get_values((void *)model->own, place, NAME_n_outputs, value);
@outputs_out@
    return NAME_told(model, answer);
}

#ifdef NAME_MAIN
/* A program to try it: `cc -DNAME_MAIN FILE.c -lm && ./a.out [STOP [POINTS [TOLERANCE]]]` prints the outputs at these instants of the experiment. */
#include <stdio.h>

/* The worse of two statuses; a first or worse one is told. */
static int NAME_worse(struct NAME_model *model, int status, int before)
{
    if (status > before) {
        fprintf(stderr, "NAME: %s (%.9g s)\n", NAME_message(model), NAME_time(model));
    }
    return status > before ? status : before;
}

int main(int count, char **words)
{
    static struct NAME_model model;
    struct NAME_inputs in;
    struct NAME_outputs out;
    const double start = @start@, stop = count > 1 ? strtod(words[1], 0) : @stop@, tolerance = count > 3 ? strtod(words[3], 0) : @tolerance@;
    const long points = count > 2 ? strtol(words[2], 0, 10) : @points@;
    long k;
    int i, status, worst = NAME_fine;
    NAME_defaults_of(&in);
    status = NAME_init(&model, NAME_defaults, &in, start, stop, tolerance);
    printf("time");
    for (i = 0; i < NAME_n_outputs; i++) {
        printf(",%s", NAME_outputs[i][0]);
    }
    printf("\n");
    for (k = 0; k < points && status <= NAME_beyond_limit; k++) {
        status = k == 0 ? status : NAME_go(&model, &in, start + (stop - start) * (double)k / (double)(points - 1));
        worst = NAME_worse(&model, status, worst);
        if (status != NAME_no_step && status != NAME_failed) {
            i = NAME_outputs_of(&model, &out);
            worst = NAME_worse(&model, i, worst);
            status = i == NAME_fine ? status : i;
        }
        if (status == NAME_no_step || status == NAME_failed) {
            break;
        }
        printf("%.17g", NAME_time(&model));
    @printed@
        printf("\n");
    }
    worst = NAME_worse(&model, status, worst);
    return worst == NAME_ended ? 0 : worst;
}
#endif
