"""The same interface as `interface.py`, as C for the folder `sources` of a unit."""

from __future__ import annotations

import re

from compiler.api import C_ARGUMENTS as ARGUMENTS
from compiler.api import c_source, c_string, small_functions

from .. import cache
from .functions import LEFT_OUT, TYPES, FmiFunction, FmiVersion
from .image import ModelImage
from .interface import CATEGORY

LONGEST_LINE = 20  # words
RESULTS = {"status": "int ", "pointer": "void *", "void": "void "}
# Arguments of the importer's function for messages, and what they are.
_LOG = {
    "fmi2": ("void *, const char *, int, const char *, const char *, ...", "environment, name, (int)status, category, messages[number]"),
    "fmi3": ("void *, int, const char *, const char *", "environment, (int)status, category, messages[number]"),
}  # fmt: skip


def c_unit(image: ModelImage, token: str, prefix: str, version: FmiVersion) -> str:
    """Return the file of a unit beside that of its program, whose names begin with a prefix."""
    names = dict.fromkeys(name for _, name in image.functions)
    declared = "".join(f"void {prefix}_{name}({ARGUMENTS});\n" for name in names)
    head = _HEAD.replace("NUMBER", version.number)
    runtime = _runtime(version)
    return "\n".join([head, declared, _data(image, token, prefix, version), small_functions(runtime), runtime])


def _runtime(version: FmiVersion) -> str:
    """Return the runtime as C and the functions of the table, the same for all models, from the cache if it is there."""
    key = cache.key_of("runtime of exported units in C", version.number)
    text = cache.fetch(key)
    if not isinstance(text, str):
        text = c_source(version.sources(), LEFT_OUT)
        text = "\n".join([text, *(_in_c(version, row, text) for row in version.rows)])
        cache.keep(key, text)
    return text


def _in_c(version: FmiVersion, row: FmiFunction, runtime: str) -> str:
    """Return the definition of one function of the table, where what the runtime only reads is constant."""
    types, passed, written = dict(row.arguments), [], {"c"}
    (taken,) = re.findall(rf"^[^ ].* {row.work.__name__}\((.*)\);$", runtime, re.MULTILINE)
    for item, declared in zip(row.passed, taken.split(", "), strict=True):
        name, _, other = item.partition("=")
        written |= set() if declared.startswith("const ") else {name}
        value = f"(int64_t){name}" if types.get(name) in ("int", "bool", "size") else name
        passed.append(f"{name} == {other} ? {value} : -1" if other else value)
    arguments = ", ".join(
        f"{'' if n in written or t != 'pointer' else 'const '}{TYPES[t][0]}{n}" for n, t in row.arguments
    )
    used = " ".join(row.passed).replace("=", " ").split()
    unused = "".join(f" (void){n};" for n, _ in row.arguments if n not in used)
    call = f"{row.work.__name__}({', '.join(passed)})"
    end = {"void": call, "pointer": f"return (void *)(intptr_t){call}", "status": f"return (int)tell(c, {call})"}[
        row.result
    ]
    return f"EXPORT {RESULTS[row.result]}{version.prefix}{row.name}({arguments})\n{{\n   {unused} {end};\n}}\n"


def _data(image: ModelImage, token: str, prefix: str, version: FmiVersion) -> str:
    """Return what a model brings."""
    texts = [f"INT64_C({w})" if w > -(2**63) else "INT64_MIN" for w in image.words(token)]
    rows = [", ".join(texts[i : i + LONGEST_LINE]) for i in range(0, len(texts), LONGEST_LINE)]
    sentences = ",\n    ".join(map(c_string, image.sentences))
    arguments, values = _LOG[version.prefix]
    lines = [
        f"static int64_t fmu_model[] = {{\n    {(',' + chr(10) + '    ').join(rows)}\n}};",
        f"static const char *const messages[] = {{\n    {sentences}\n}};",
        _FMU_LOG.replace("ARGUMENTS", arguments).replace("VALUES", values).replace("CATEGORY", CATEGORY),
        *(f'EXPORT const char *{version.prefix}{name}(void) {{ return "{text}"; }}' for name, text in version.texts.items()),
        "static void fmu_connect(int64_t *block)\n{",
        *(f"    block[{at}] = (int64_t)(intptr_t){prefix}_{name};" for at, name in image.functions),
    ]  # fmt: skip
    return "\n".join([*lines, "}\n"])


_HEAD = """/* The functions of FMI NUMBER for the program beside this file: generated, C11. Compile without contraction of operations
   (-ffp-contract=off) to get the numbers of the libraries in the folder `binaries`. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
"""
_FMU_LOG = """static void fmu_log(const int64_t *own, size_t status, size_t number)
{
    void (*logger)(ARGUMENTS) = (void (*)(ARGUMENTS))(intptr_t)own[0];
    void *environment = (void *)(intptr_t)own[1];
    const char *name = (const char *)(intptr_t)own[2], *category = "CATEGORY";
    (void)name;
    logger(VALUES);
}
"""
