"""The subcommand `nyu-lists`."""

import argparse
from pathlib import Path

from nunet_models.data.nyu_mat import read_splits
from nunet_models.errors import ConfigError


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `nyu-lists` and its options."""
    parser = subparsers.add_parser(
        "nyu-lists", help="write lists of ids of NYU Depth V2's official split"
    )
    parser.add_argument("--splits", type=Path, required=True, help="the dataset's splits.mat")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder to write train.txt and test.txt into"
    )
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `nyu-lists`; prints the files written."""
    lists = {
        options.out / f"{name}.txt": "".join(f"{identity}\n" for identity in ids)
        for name, ids in read_splits(options.splits).items()
    }
    for path, text in lists.items():
        if path.exists() and path.read_bytes() != text.encode():
            raise ConfigError(f"`{path}` exists and is another list", hint="another `--out`")
    options.out.mkdir(parents=True, exist_ok=True)
    for path, text in lists.items():
        path.write_text(text, encoding="utf-8")
        print(f"{path}: {text.count(chr(10))} images")
    return 0
