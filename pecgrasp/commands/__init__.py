"""One module a command, imported only when it is called; it parses its settings, calls the packages, prints a table."""
