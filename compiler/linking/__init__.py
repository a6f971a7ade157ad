"""Object code to shared libraries, without a linker on the user's machine."""
