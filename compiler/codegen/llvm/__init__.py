"""The native target: machine code through LLVM."""
