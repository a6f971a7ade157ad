"""Plain numeric Python to machine code, through LLVM IR; nothing here knows what a bond graph is."""
