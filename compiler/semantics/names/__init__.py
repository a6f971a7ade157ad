"""Names and their meanings: files, scopes, domains of ports, and errors in the text."""
