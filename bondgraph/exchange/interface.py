"""The functions of FMI around those of the runtime, as LLVM IR.

What a model brings: `fmu_model` (see `runtime/memory.py`), `fmu_connect`, which puts the addresses of its functions into a block, and what
depends on the version of FMI alone: `fmu_log` for messages, and texts.
"""

from __future__ import annotations

from .functions import TYPES, VERSIONS, FmiFunction, FmiVersion
from .image import ModelImage

CATEGORY = "logStatus"
RESULTS = {"status": "i32", "pointer": "ptr", "void": "void"}
# How a version hands over a message: to the type of the importer's function, its arguments.
_LOG = {
    "fmi2": "call void (ptr, ptr, i32, ptr, ptr, ...) %logger(ptr %env, ptr %name, i32 %level, ptr @category, ptr %text)",
    "fmi3": "call void %logger(ptr %env, i32 %level, ptr @category, ptr %text)",
}


def _text(text: str, width: int = 0) -> str:
    """Return a text as a constant of LLVM."""
    data = text.encode("utf-8")
    data = data.ljust(max(width, len(data) + 1), b"\0")
    return f'[{len(data)} x i8] c"{"".join(f"{chr(b)}" if 32 <= b < 127 and b not in (34, 92) else f"{chr(92)}{b:02X}" for b in data)}"'


def llvm_interface() -> str:
    """Return the definitions of the functions of all versions, to be added to the runtime's."""
    rows = [_in_llvm(version, row) for version in VERSIONS.values() for row in version.rows]
    return "\n".join(["@fmu_model = external constant i64", *rows])


def _in_llvm(version: FmiVersion, row: FmiFunction) -> str:
    """Return the definition of one function of the table."""
    arguments = ", ".join(f"{TYPES[t][1]} %{n}" for n, t in row.arguments)
    types, lines, passed = dict(row.arguments), [], []
    for item in row.passed:
        name, _, other = item.partition("=")
        kind = TYPES[types[name]][1] if name in types else "ptr"
        value = f"%{name}" if name in types else f"@{name}"
        if kind in ("i32", "i8"):
            lines.append(f"  {value}.w = {'sext' if kind == 'i32' else 'zext'} {kind} {value} to i64")
            kind, value = "i64", f"{value}.w"
        if other:
            lines.append(f"  {value}.same = icmp eq i64 {value}, %{other}")
            lines.append(f"  {value}.or = select i1 {value}.same, i64 {value}, i64 -1")
            value = f"{value}.or"
        passed.append(f"{kind} {value}")
    call = f"call {'void' if row.result == 'void' else 'i64'} @{row.work.__name__}({', '.join(passed)})"
    end = {
        "void": f"  {call}\n  ret void",
        "pointer": f"  %answer = {call}\n  %c = inttoptr i64 %answer to ptr\n  ret ptr %c",
        "status": f"  %answer = {call}\n  %told = call i64 @tell(ptr %c, i64 %answer)\n  %status = trunc i64 %told to i32\n  ret i32 %status",
    }[row.result]
    return "\n".join([f"define {RESULTS[row.result]} @{version.prefix}{row.name}({arguments}) {{", *lines, end, "}\n"])


def llvm_data(image: ModelImage, token: str, version: FmiVersion) -> str:
    """Return what a model brings, as LLVM IR."""
    words = image.words(token)
    width = max(map(len, image.sentences)) + 1
    lines = [
        f"@fmu_model = constant [{len(words)} x i64] [{', '.join(f'i64 {w}' for w in words)}]",
        f"@messages = private unnamed_addr constant [{len(image.sentences)} x [{width} x i8]] [{', '.join(_text(m, width) for m in image.sentences)}]",
        f"@category = private unnamed_addr constant {_text(CATEGORY)}",
        _FMU_LOG.replace("WIDTH", str(width)).replace("CALL", _LOG[version.prefix]),
    ]
    for name, text in version.texts.items():
        lines += [
            f"@text.{name} = private unnamed_addr constant {_text(text)}",
            f"define ptr @{version.prefix}{name}() {{\n  ret ptr @text.{name}\n}}",
        ]
    lines.append("define void @fmu_connect(ptr %block) {")
    for at, name in image.functions:
        lines += [f"  %p{at} = getelementptr inbounds i64, ptr %block, i64 {at}", f"  store ptr @{name}, ptr %p{at}"]
    return "\n".join([*lines, "  ret void", "}", ""])


_FMU_LOG = """define void @fmu_log(ptr %own, i64 %status, i64 %number) {
  %logger = load ptr, ptr %own
  %env.p = getelementptr inbounds i64, ptr %own, i64 1
  %env = load ptr, ptr %env.p
  %name.p = getelementptr inbounds i64, ptr %own, i64 2
  %name = load ptr, ptr %name.p
  %text = getelementptr inbounds [WIDTH x i8], ptr @messages, i64 %number
  %level = trunc i64 %status to i32
  CALL
  ret void
}"""
