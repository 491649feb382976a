"""`stickslip completion`: what a shell needs to complete commands and options, made from the parser itself."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping

from identify.cli.common import Answer, Terminal

NAME = "completion"
HELP = "a script that completes commands and options, for bash, zsh or fish"
WHERE = {
    "bash": 'eval "$(stickslip completion bash)"      # in ~/.bashrc',
    "zsh": 'eval "$(stickslip completion zsh)"       # in ~/.zshrc, after compinit',
    "fish": "stickslip completion fish | source        # in ~/.config/fish/config.fish",
}
BASH = """\
_stickslip() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} words="{commands}"
  if (( COMP_CWORD > 1 )); then
    case ${{COMP_WORDS[1]}} in
{cases}
    esac
    [[ $word == -* ]] || words=""
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _stickslip stickslip
"""


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("shell", choices=WHERE, help=f"such as: {WHERE['bash']}")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Print the script."""
    script = script_for(arguments.shell, arguments.parser.commands)
    terminal.say(script.rstrip())
    return Answer(document={"status": "done", "shell": arguments.shell, "script": script})


def script_for(shell: str, commands: Mapping[str, ArgumentParser]) -> str:
    """The script for a shell; what is no option is completed as a file, as the shell does."""
    if shell == "fish":
        lines = ["complete -c stickslip -n __fish_use_subcommand -f -a " + f"'{' '.join(commands)}'"]
        for name, parser in commands.items():
            seen = f"__fish_seen_subcommand_from {name}"
            lines += [f"complete -c stickslip -n '{seen}' -l {o.removeprefix('--')}" for o in _options(parser)]
        return "\n".join(lines) + "\n"
    cases = "\n".join(f'      {name}) words="{" ".join(_options(parser))}" ;;' for name, parser in commands.items())
    script = BASH.format(commands=" ".join(commands), cases=cases)
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def _options(parser: ArgumentParser) -> list[str]:
    return [option for option in parser._option_string_actions if option.startswith("--")]
