"""How files of YAML, JSON, XML, NumPy's arrays and plain text are opened: one bounded opener a kind, for the package.

Each takes files that others have made. It bounds bytes, depth and numbers before it builds anything, refuses a name
that stands twice, never unpickles, and raises nothing but `RequestError`, whose line names the file. What the content
should be is up to the reader: `refusing` makes one line of what fails there. Images are decoded from their bytes.
"""
