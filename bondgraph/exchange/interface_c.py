"""The same interface as `interface.py`, as C for the folder `sources` of a unit."""

from __future__ import annotations

from compiler.api import C_ARGUMENTS as ARGUMENTS
from compiler.api import C_BEGINNING, c_source, record_of

from .. import cache
from .functions import FMI_2, LEFT_OUT, TYPES, FmiFunction, sources
from .image import ModelImage
from .interface import BEFORE
from .messages import MESSAGES
from .runtime.instance import FmuInstance

LONGEST_LINE = 20  # words


def c_unit(image: ModelImage, token: str, prefix: str) -> str:
    """Return the file of a unit beside that of its program, whose names begin with a prefix."""
    names = dict.fromkeys(name for _, name in image.functions)
    declared = "".join(f"void {prefix}_{name}({ARGUMENTS});\n" for name in names)
    parts = (_HEAD, declared, C_BEGINNING, _runtime(), _data(image, token, prefix), _interface())
    return "\n".join(parts)


def _runtime() -> str:
    """Return the runtime as C, the same for all models, from the cache if it is there."""
    key = cache.key_of("runtime of exported units in C")
    text = cache.fetch(key)
    if not isinstance(text, str):
        text = c_source(sources(), LEFT_OUT)
        cache.keep(key, text)
    return text


def _interface() -> str:
    """Return the functions that an importer calls."""
    place = record_of(FmuInstance).place("message")
    sentences = ",\n    ".join(f'"{m}"' for m in MESSAGES)
    head = f"static const char *const messages[] = {{\n    {sentences}\n}};\n"
    fixed = _C.replace("BEFORE", str(BEFORE)).replace("MESSAGE", str(place))
    return "\n".join([head, fixed, *map(_in_c, FMI_2)])


def _in_c(row: FmiFunction) -> str:
    """Return the definition of one function of the table."""
    arguments = ", ".join(f"{TYPES[t][0]}{n}" for n, t in row.arguments)
    types = dict(row.arguments)
    passed = ", ".join(f"(int64_t){n}" if types[n] in ("int", "size") else n for n in row.passed)
    unused = "".join(f" (void){n};" for n, _ in row.arguments if n not in row.passed)
    return (
        f"EXPORT int fmi2{row.name}({arguments})\n{{\n   {unused} return told(c, {row.work.__name__}({passed}));\n}}\n"
    )


def _data(image: ModelImage, token: str, prefix: str) -> str:
    """Return the image as C, with the function that puts the addresses of functions into a block."""
    lines = [
        _array("fmu_image", image.head), _array("fmu_inside", image.inside),
        _array("fmu_sizes", (image.size, len(image.head), len(image.inside))), f'static const char fmu_guid[] = "{token}";',
        "static void fmu_connect(int64_t *block)\n{",
    ]  # fmt: skip
    lines += [f"    block[{at}] = (int64_t)(intptr_t){prefix}_{name};" for at, name in image.functions]
    return "\n".join([*lines, "}\n"])


def _array(name: str, words: tuple[int, ...]) -> str:
    texts = [f"INT64_C({w})" if w > -(2**63) else "INT64_MIN" for w in words]
    rows = [", ".join(texts[i : i + LONGEST_LINE]) for i in range(0, len(texts), LONGEST_LINE)]
    return f"static int64_t {name}[] = {{\n    {(',' + chr(10) + '    ').join(rows)}\n}};"


_HEAD = """/* The functions of FMI 2.0 for the program beside this file: generated, C11. Compile without contraction of operations
   (-ffp-contract=off) to get the numbers of the libraries in the folder `binaries`. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
"""
_C = """#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
typedef void (*logger_function)(void *, const char *, int, const char *, const char *, ...);

static int told(void *c, int64_t answer)
{
    int64_t *block = c;
    void **before = (void **)(block - BEFORE);
    const int64_t number = block[MESSAGE];
    if (number != 0) {
        block[MESSAGE] = 0;
        if (before[0]) {
            ((logger_function)(intptr_t)before[0])(before[1], before[2], (int)answer, "logStatus", "%s", messages[number]);
        }
    }
    return (int)answer;
}

static void placed(void *c)
{
    place_inside(c, (int64_t)(intptr_t)c, fmu_image, fmu_inside, fmu_sizes[2]);
    fmu_connect(c);
}

static void prepare(int64_t *c, int64_t steps)
{
    memcpy(c, fmu_image, 8 * (size_t)fmu_sizes[1]);
    memset(c + fmu_sizes[1], 0, 8 * (size_t)(fmu_sizes[0] - fmu_sizes[1]));
    placed(c);
    reset((struct FmuInstance *)c, steps);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(void *c, int on, size_t count, void *categories)
{
    (void)c; (void)on; (void)count; (void)categories;
    return 0;
}

EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, void **callbacks, int visible, int logging)
{
    int64_t *memory;
    char *copy;
    (void)resources; (void)visible; (void)logging;
    if (strcmp(guid, fmu_guid) != 0) return NULL;
    memory = calloc((size_t)fmu_sizes[0] + BEFORE, 8);
    copy = malloc(strlen(name) + 1);
    if (!memory || !copy) {
        free(memory);
        free(copy);
        return NULL;
    }
    memcpy(copy, name, strlen(name) + 1);
    ((void **)memory)[0] = callbacks[0];
    ((void **)memory)[1] = callbacks[4];
    ((void **)memory)[2] = copy;
    prepare(memory + BEFORE, kind);
    return memory + BEFORE;
}

EXPORT void fmi2FreeInstance(void *c)
{
    int64_t *memory = c;
    if (!c) return;
    memory -= BEFORE;
    free(((void **)memory)[2]);
    free(memory);
}

EXPORT int fmi2Reset(void *c)
{
    prepare(c, makes_own_steps(c));
    return 0;
}

EXPORT int fmi2GetFMUstate(void *c, void **state)
{
    const size_t size = 8 * (size_t)fmu_sizes[0];
    if (!*state) *state = malloc(size);
    if (!*state) return 3;
    memcpy(*state, c, size);
    return 0;
}

EXPORT int fmi2SetFMUstate(void *c, void *state)
{
    memcpy(c, state, 8 * (size_t)fmu_sizes[0]);
    placed(c);
    return 0;
}

EXPORT int fmi2FreeFMUstate(void *c, void **state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return 0;
}

EXPORT int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    (void)c; (void)state;
    *size = 8 * (size_t)fmu_sizes[0];
    return 0;
}

EXPORT int fmi2SerializeFMUstate(void *c, void *state, void *data, size_t size)
{
    (void)c;
    if (size < 8 * (size_t)fmu_sizes[0]) return 3;
    memcpy(data, state, 8 * (size_t)fmu_sizes[0]);
    place_inside(data, 0, fmu_image, fmu_inside, fmu_sizes[2]);
    return 0;
}

EXPORT int fmi2DeSerializeFMUstate(void *c, const void *data, size_t size, void **state)
{
    if (size != 8 * (size_t)fmu_sizes[0]) return 3;
    *state = NULL;
    if (fmi2GetFMUstate(c, state) != 0) return 3;
    memcpy(*state, data, size);
    return 0;
}
"""
