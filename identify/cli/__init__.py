"""The command line: arguments in, words and files out; no physics. One file per command, imported by nobody.

A command is a module with NAME, HELP, `add_arguments(parser)` and `run(arguments, terminal) -> Answer`;
it stands in the table of `main.py` (`commands`). Whatever is heavy is imported inside `run`, so that help is instant.
"""
