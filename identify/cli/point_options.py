"""The options of the calculators; apart from their work, so that help needs nothing heavy."""

from __future__ import annotations

from argparse import ArgumentParser


def add_point_arguments(parser: ArgumentParser) -> None:
    """Where the answers are asked for."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--scene", metavar="SCENE.toml", help="the values of a scene: fixed, else start, else default")
    source.add_argument("--result", metavar="result.json", help="the estimates of a fit, with their uncertainty")
    parser.add_argument(
        "--at",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help='operating point, repeatable: drive_speed="1 mm/s", normal_force, or any parameter (default: each log)',
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="EFFECT",
        help="leave out an effect of the scene, repeatable: one with which no cycle is like the one before",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw it over drive speed (png, svg or pdf)")
