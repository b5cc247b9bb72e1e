"""The command lines, one file each.

A command line is a frozen dataclass whose field docstrings are its help. Modules that take long to import are imported
only after the options have been parsed, so that `--help` and a mistyped option are answered at once.
"""
