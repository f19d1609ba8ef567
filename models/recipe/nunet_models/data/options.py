"""Command-line options for the data and its units."""

import argparse
import math
from pathlib import Path

from nunet_models.data.cache import Cached, build_cache
from nunet_models.data.nyu_mat import MAT_SUFFIX, NyuMatPairs
from nunet_models.data.pairs import MILLIMETER_M, DepthUnits, FolderPairs, Pairs, read_ids
from nunet_models.errors import OptionError


def add_data_options(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add the options that `open_pairs` reads."""
    group = parser.add_argument_group("data")
    group.add_argument(
        "--data",
        type=Path,
        required=required,
        help="folder of rgb/, depth/ and labels/ or label40/, or NYU's .mat",
    )
    group.add_argument(
        "--class-map",
        type=Path,
        metavar="FILE",
        help="classMapping40.mat of Gupta et al., by which NYU's .mat has labels",
    )
    group.add_argument(
        "--depth-scale",
        type=float,
        help=f"meters per unit of the depth images (default {MILLIMETER_M}, for 16 bits alone)",
    )
    group.add_argument(
        "--depth-offset",
        type=float,
        default=0.0,
        help="added to each value before scaling; if not 0, the value 0 is a measurement",
    )
    group.add_argument(
        "--window",
        metavar="TOP,LEFT,BOTTOM,RIGHT",
        help="pixels outside have no truth, for data with a frame around each image",
    )


def open_pairs(options: argparse.Namespace, ids: Path) -> Pairs:
    """The pairs that the options and an id list name."""
    window = _parse_window(options.window)
    if options.data.suffix == MAT_SUFFIX:
        _check_no_units(options)
        return NyuMatPairs(options.data, read_ids(ids), class_map=options.class_map, window=window)
    if options.class_map is not None:
        raise OptionError(
            f"`--class-map {options.class_map}` is for the labels of NYU's .mat; `{options.data}` "
            "is a folder, with `labels/` or `label40/`",
            hint="omit `--class-map`",
        )
    _check_units(options)
    units = DepthUnits(
        options.depth_scale, options.depth_offset, zero_is_none=options.depth_offset == 0.0
    )
    return FolderPairs(options.data, read_ids(ids), units=units, window=window)


def add_cache_option(parser: argparse.ArgumentParser) -> None:
    """Add the additional option that `open_cached` reads."""
    parser.add_argument("--cache", type=Path, help="folder for decoded images of `--data`")


def add_sets_option(parser: argparse.ArgumentParser) -> None:
    """Add the dataset list, which takes the place of `--data` and its options."""
    parser.add_argument(
        "--sets",
        type=Path,
        metavar="LIST.toml",
        help="dataset list: folders of several cameras, instead of `--data`",
    )


_WITHOUT_SETS = ("data", "class_map", "depth_scale", "window", "cache")


def check_sets_or_data(options: argparse.Namespace, *needed: str) -> None:
    """Refuse `--sets` together with the options of `--data`, and a command with neither.

    `needed` names the options that go with `--data`.

    # Errors
    `OptionError` naming the option.
    """
    if options.sets is None:
        for name in ("data", *needed):
            if getattr(options, name) is None:
                raise OptionError(f"`{_flag(name)}` is missing", hint="pass it, or `--sets LIST`")
        return
    given = {name: getattr(options, name, None) for name in (*_WITHOUT_SETS, *needed)}
    given["depth_offset"] = options.depth_offset or None  # 0 is the default
    for name, value in given.items():
        if value is not None:
            raise OptionError(
                f"`{_flag(name)}` cannot be combined with `--sets {options.sets}`; it is set there"
            )


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def open_cached(options: argparse.Namespace, ids: Path) -> Cached:
    """As `open_pairs`, decoded into `--cache`."""
    return build_cache(open_pairs(options, ids), options.cache, quiet=options.quiet)


def _check_no_units(options: argparse.Namespace) -> None:
    given = {"--depth-scale": options.depth_scale, "--depth-offset": options.depth_offset or None}
    for option, value in given.items():
        if value is not None:
            raise OptionError(
                f"`{option} {value}` is for images of depth; `{options.data}` contains meters",
                hint=f"omit `{option}`",
            )


def _check_units(options: argparse.Namespace) -> None:
    scale, offset = options.depth_scale, options.depth_offset
    if scale is not None and not 0.0 < scale < math.inf:
        raise OptionError(f"`--depth-scale {scale}`; expected meters per unit, more than 0")
    if not math.isfinite(offset):
        raise OptionError(f"`--depth-offset {offset}`; expected a number")


def _parse_window(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    try:
        top, left, bottom, right = (int(part) for part in text.split(","))
    except ValueError as error:
        raise OptionError(f"`--window {text}` is not four whole numbers") from error
    if not (0 <= top < bottom and 0 <= left < right):
        raise OptionError(
            f"`--window {text}` leaves nothing; expected TOP,LEFT,BOTTOM,RIGHT in pixels from 0, "
            "TOP less than BOTTOM and LEFT less than RIGHT"
        )
    return top, left, bottom, right
