"""Methods that step through a smooth stretch, in numpy and in machine code, and their linear algebra."""
