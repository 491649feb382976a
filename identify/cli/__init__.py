"""The command line: arguments in, words and files out; no physics. One file per group of commands, imported by nobody.

The table of commands is `commands.py`. Whatever is heavy is imported inside the `run`
of a command, so that help is instant.
"""
