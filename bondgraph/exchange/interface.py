"""Functions of FMI 2.0 around those of the runtime, as LLVM IR and as C: types of C, memory, texts and messages.

An instance is a block of memory: words of the interface (`BEFORE`), then the image of the unit, whose addresses within itself are adapted.
The parts that a model brings: `fmu_image`, `fmu_inside` (indices of addresses), `fmu_sizes` (words of a block, words of the image, number
of addresses), `fmu_guid`, and `fmu_connect`, which puts the addresses of the model's functions into a block.
"""

from __future__ import annotations

from compiler.api import record_of

from .functions import FMI_2, TYPES, FmiFunction
from .messages import MESSAGES
from .runtime.instance import FmuInstance

BEFORE = 4  # words in front of a record: function for messages, environment of the importer, name of the instance


def _text(text: str, width: int = 0) -> str:
    """Return a text as a constant of LLVM."""
    data = text.encode("utf-8")
    data = data.ljust(max(width, len(data) + 1), b"\0")
    return f'[{len(data)} x i8] c"{"".join(f"{chr(b)}" if 32 <= b < 127 and b not in (34, 92) else f"{chr(92)}{b:02X}" for b in data)}"'


def llvm_interface() -> str:
    """Return the definitions as LLVM IR, to be added to the runtime's."""
    width = max(map(len, MESSAGES)) + 1
    rows = ", ".join(_text(m, width) for m in MESSAGES)
    head = f"@messages = private unnamed_addr constant [{len(MESSAGES)} x [{width} x i8]] [{rows}]\n"
    place = record_of(FmuInstance).place("message")
    fixed = _LLVM.replace("BEFORE", str(BEFORE)).replace("MESSAGE", str(place)).replace("WIDTH", str(width))
    return "\n".join([head, fixed, *map(_in_llvm, FMI_2)])


def _in_llvm(row: FmiFunction) -> str:
    """Return the definition of one function of the table."""
    arguments = ", ".join(f"{TYPES[t][1]} %{n}" for n, t in row.arguments)
    types, lines, passed = dict(row.arguments), [], []
    for name in row.passed:
        kind = TYPES[types[name]][1]
        if kind == "i32":
            lines.append(f"  %{name}.w = sext i32 %{name} to i64")
            kind, name = "i64", f"{name}.w"
        passed.append(f"{kind} %{name}")
    call = f"  %answer = call i64 @{row.work.__name__}({', '.join(passed)})"
    end = "  %status = call i32 @fmu_told(ptr %c, i64 %answer)\n  ret i32 %status\n}\n"
    return "\n".join([f"define i32 @fmi2{row.name}({arguments}) {{", *lines, call, end])


_LLVM = """
@fmu_image = external constant i64
@fmu_inside = external constant i64
@fmu_sizes = external constant [3 x i64]
@fmu_guid = external constant i8
@platform = private unnamed_addr constant [8 x i8] c"default\\00"
@version = private unnamed_addr constant [4 x i8] c"2.0\\00"
@category = private unnamed_addr constant [10 x i8] c"logStatus\\00"
declare void @fmu_connect(ptr)
declare ptr @calloc(i64, i64)
declare ptr @malloc(i64)
declare void @free(ptr)
declare ptr @memcpy(ptr, ptr, i64)
declare i64 @strlen(ptr)
declare i32 @strcmp(ptr, ptr)

define internal i32 @fmu_told(ptr %c, i64 %answer) {
  %place = getelementptr inbounds i64, ptr %c, i64 MESSAGE
  %number = load i64, ptr %place
  %silent = icmp eq i64 %number, 0
  br i1 %silent, label %end, label %say
say:
  store i64 0, ptr %place
  %logger.p = getelementptr inbounds i64, ptr %c, i64 -BEFORE
  %logger = load ptr, ptr %logger.p
  %none = icmp eq ptr %logger, null
  br i1 %none, label %end, label %call
call:
  %env.p = getelementptr inbounds i64, ptr %logger.p, i64 1
  %env = load ptr, ptr %env.p
  %name.p = getelementptr inbounds i64, ptr %logger.p, i64 2
  %name = load ptr, ptr %name.p
  %text = getelementptr inbounds [WIDTH x i8], ptr @messages, i64 %number
  %level = trunc i64 %answer to i32
  call void (ptr, ptr, i32, ptr, ptr, ...) %logger(ptr %env, ptr %name, i32 %level, ptr @category, ptr %text)
  br label %end
end:
  %result = trunc i64 %answer to i32
  ret i32 %result
}

define internal i64 @fmu_bytes() {
  %words = load i64, ptr @fmu_sizes
  %bytes = shl i64 %words, 3
  ret i64 %bytes
}

define internal void @fmu_placed(ptr %c) {
  %address = ptrtoint ptr %c to i64
  %count.p = getelementptr inbounds i64, ptr @fmu_sizes, i64 2
  %count = load i64, ptr %count.p
  call void @place_inside(ptr %c, i64 %address, ptr @fmu_image, ptr @fmu_inside, i64 %count)
  call void @fmu_connect(ptr %c)
  ret void
}

define internal void @fmu_renew(ptr %c, i64 %steps) {
  %length.p = getelementptr inbounds i64, ptr @fmu_sizes, i64 1
  %length = load i64, ptr %length.p
  %head = shl i64 %length, 3
  %whole = call i64 @fmu_bytes()
  %rest = sub i64 %whole, %head
  %copied = call ptr @memcpy(ptr %c, ptr @fmu_image, i64 %head)
  %tail = getelementptr inbounds i64, ptr %c, i64 %length
  call void @llvm.memset.p0.i64(ptr %tail, i8 0, i64 %rest, i1 false)
  call void @fmu_placed(ptr %c)
  call void @reset(ptr %c, i64 %steps)
  ret void
}
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)

define ptr @fmi2GetTypesPlatform() {
  ret ptr @platform
}

define ptr @fmi2GetVersion() {
  ret ptr @version
}

define i32 @fmi2SetDebugLogging(ptr %c, i32 %on, i64 %count, ptr %categories) {
  ret i32 0
}

define ptr @fmi2Instantiate(ptr %name, i32 %kind, ptr %guid, ptr %resources, ptr %callbacks, i32 %visible, i32 %logging) {
  %differs = call i32 @strcmp(ptr %guid, ptr @fmu_guid)
  %other = icmp ne i32 %differs, 0
  br i1 %other, label %refuse, label %take
refuse:
  ret ptr null
take:
  %words = load i64, ptr @fmu_sizes
  %all = add i64 %words, BEFORE
  %memory = call ptr @calloc(i64 %all, i64 8)
  %no = icmp eq ptr %memory, null
  br i1 %no, label %refuse, label %named
named:
  %length = call i64 @strlen(ptr %name)
  %size = add i64 %length, 1
  %copy = call ptr @malloc(i64 %size)
  %missing = icmp eq ptr %copy, null
  br i1 %missing, label %drop, label %made
drop:
  call void @free(ptr %memory)
  ret ptr null
made:
  %copied = call ptr @memcpy(ptr %copy, ptr %name, i64 %size)
  %logger = load ptr, ptr %callbacks
  store ptr %logger, ptr %memory
  %env.p = getelementptr inbounds ptr, ptr %callbacks, i64 4
  %env = load ptr, ptr %env.p
  %own.p = getelementptr inbounds i64, ptr %memory, i64 1
  store ptr %env, ptr %own.p
  %name.p = getelementptr inbounds i64, ptr %memory, i64 2
  store ptr %copy, ptr %name.p
  %c = getelementptr inbounds i64, ptr %memory, i64 BEFORE
  %steps = sext i32 %kind to i64
  call void @fmu_renew(ptr %c, i64 %steps)
  ret ptr %c
}

define void @fmi2FreeInstance(ptr %c) {
  %none = icmp eq ptr %c, null
  br i1 %none, label %end, label %given
given:
  %memory = getelementptr inbounds i64, ptr %c, i64 -BEFORE
  %name.p = getelementptr inbounds i64, ptr %memory, i64 2
  %name = load ptr, ptr %name.p
  call void @free(ptr %name)
  call void @free(ptr %memory)
  br label %end
end:
  ret void
}

define i32 @fmi2Reset(ptr %c) {
  %steps = call i64 @makes_own_steps(ptr %c)
  call void @fmu_renew(ptr %c, i64 %steps)
  ret i32 0
}

define i32 @fmi2GetFMUstate(ptr %c, ptr %state) {
  %old = load ptr, ptr %state
  %none = icmp eq ptr %old, null
  br i1 %none, label %new, label %take
new:
  %size = call i64 @fmu_bytes()
  %fresh = call ptr @malloc(i64 %size)
  %failed = icmp eq ptr %fresh, null
  br i1 %failed, label %refuse, label %keep
refuse:
  ret i32 3
keep:
  store ptr %fresh, ptr %state
  br label %take
take:
  %to = load ptr, ptr %state
  %length = call i64 @fmu_bytes()
  %copied = call ptr @memcpy(ptr %to, ptr %c, i64 %length)
  ret i32 0
}

define i32 @fmi2SetFMUstate(ptr %c, ptr %state) {
  %size = call i64 @fmu_bytes()
  %copied = call ptr @memcpy(ptr %c, ptr %state, i64 %size)
  call void @fmu_placed(ptr %c)
  ret i32 0
}

define i32 @fmi2FreeFMUstate(ptr %c, ptr %state) {
  %old = load ptr, ptr %state
  call void @free(ptr %old)
  store ptr null, ptr %state
  ret i32 0
}

define i32 @fmi2SerializedFMUstateSize(ptr %c, ptr %state, ptr %size) {
  %bytes = call i64 @fmu_bytes()
  store i64 %bytes, ptr %size
  ret i32 0
}

define i32 @fmi2SerializeFMUstate(ptr %c, ptr %state, ptr %data, i64 %size) {
  %bytes = call i64 @fmu_bytes()
  %small = icmp ult i64 %size, %bytes
  br i1 %small, label %refuse, label %take
refuse:
  ret i32 3
take:
  %copied = call ptr @memcpy(ptr %data, ptr %state, i64 %bytes)
  %count.p = getelementptr inbounds i64, ptr @fmu_sizes, i64 2
  %count = load i64, ptr %count.p
  call void @place_inside(ptr %data, i64 0, ptr @fmu_image, ptr @fmu_inside, i64 %count)
  ret i32 0
}

define i32 @fmi2DeSerializeFMUstate(ptr %c, ptr %data, i64 %size, ptr %state) {
  %bytes = call i64 @fmu_bytes()
  %other = icmp ne i64 %size, %bytes
  br i1 %other, label %refuse, label %take
refuse:
  ret i32 3
take:
  store ptr null, ptr %state
  %got = call i32 @fmi2GetFMUstate(ptr %c, ptr %state)
  %failed = icmp ne i32 %got, 0
  br i1 %failed, label %refuse, label %copy
copy:
  %to = load ptr, ptr %state
  %copied = call ptr @memcpy(ptr %to, ptr %data, i64 %bytes)
  ret i32 0
}
"""
