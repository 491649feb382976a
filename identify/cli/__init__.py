"""The command line: arguments in, words and files out; no physics. One file per group of commands, imported by nobody.

The module of a group has COMMANDS and stands in the table of `main.py`. Whatever is heavy is imported inside the `run`
of a command, so that help is instant.
"""
