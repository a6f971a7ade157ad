"""The language server: the language service, spoken to editors over standard input and output."""
