"""The command line: arguments in, words and files out; no physics. One file per group of commands, imported by nobody.

A command has NAME, HELP, `add_arguments(parser)` and `run(arguments, terminal) -> Answer`: a module with these names,
or a `Command` in the COMMANDS of one; its module stands in the table of `main.py`. Whatever is heavy is imported inside
`run`, so that help is instant.
"""
