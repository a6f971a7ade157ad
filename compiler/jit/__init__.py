"""Plain numeric Python to machine code, through LLVM IR, without any knowledge of bond graphs."""
