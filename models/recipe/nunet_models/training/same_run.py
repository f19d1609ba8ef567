"""Differences of a run's graph, data and weights from what the options describe, per option."""

from typing import Any

from nunet_models.zoo.confidence import CONFIDENCE
from nunet_models.zoo.spec import Camera, GraphSpec, decoder_name

_DATA_OPTIONS = {
    "name": "--data",
    "class_map": "--class-map",
    "depth_scale": "--depth-scale",
    "depth_offset": "--depth-offset",
    "window": "--window",
}
_LIST_OPTIONS = {"train": "--train-ids", "val": "--val-ids"}
_ORIGIN_OPTIONS = {
    "start": "--start",
    "begin_with": "--begin-with",
    "imagenet": "--imagenet",
    "like": "--like",
    "plug_decoder": "--plug-decoder",
    "freeze_decoder": "--freeze-decoder",
}
_DIGITS = 12  # of a SHA-256 that tell two files apart for a reader


def graph_differences(started: GraphSpec, given: GraphSpec, component: str) -> list[str]:
    """A phrase for each option that makes the graph to train `component` another one."""
    before, now = (_graph_options_of(spec, component) for spec in (started, given))
    return [
        difference(option, value, now[option])
        for option, value in before.items()
        if value != now[option]
    ]


def provenance_differences(started: dict[str, Any], given: dict[str, Any]) -> list[str]:
    """A phrase for each difference of data and of where the weights began (`run_provenance`).

    Files are compared by content, not by path. Values that `started` lacks, because an earlier
    version wrote it, are not compared.
    """
    found = []
    before, now = started.get("data", {}), given.get("data", {})
    for name, option in _DATA_OPTIONS.items():
        if name in before and name in now and _content(before[name]) != _content(now[name]):
            found.append(difference(option, before[name], now[name]))
    for name, option in _LIST_OPTIONS.items():
        if name in before and name in now and before[name] != now[name]:
            found.append(f"another list than that of `{option}`")
    found += _set_differences(before, now)
    if "origin" in started and "origin" in given:
        before, now = _origins(started["origin"]), _origins(given["origin"])
        for option in before | now:
            one, other = before.get(option), now.get(option)
            if _content(one) != _content(other):
                found.append(difference(option, one, other))
    return found


def _set_differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Other sets, or other images in sets that do not grow."""
    if before and now and ("sets" in before) != ("sets" in now):
        return [difference("--sets", before.get("sets"), now.get("sets"))]
    found = []
    for use in ("train_sets", "val_sets"):
        one, other = (_settled(data.get(use, [])) for data in (before, now))
        names = {name for name in one | other if one.get(name) != other.get(name)}
        found += [f"another set `{name}` in the list of `--sets`" for name in sorted(names)]
    if before.get("epoch_images") != now.get("epoch_images"):
        one, other = before.get("epoch_images"), now.get("epoch_images")
        found.append(difference("--epoch-images", one, other))
    return found


def _settled(sets: list[dict[str, Any]]) -> dict[str, Any]:
    """Content by name; of a set that grows its name alone."""
    return {of["set"]: "growing" if of["growing"] else of["ids_sha256"] for of in sets}


def graph_options(spec: GraphSpec) -> dict[str, str]:
    """A graph by the options that make it, as they are written on the command line."""
    decoders = [decoder_name(c.decoder_channels) for c in spec.components]
    return {
        "--architecture": spec.architecture,
        "--tasks": ",".join(c.task for c in spec.components),
        "--sigmoid-joint": ",".join(c.name for c in spec.components if c.sigmoid_joint),
        "--backbone": ",".join(c.backbone for c in spec.components),
        "--decoder": ",".join(dict.fromkeys(decoders)),
        "--inner-size": "{} {}".format(*spec.inner_size),
        "--encoding": spec.encoding,
        "--intrinsics": _intrinsics(spec.camera),
    }


def _graph_options_of(spec: GraphSpec, component: str) -> dict[str, str]:
    """The same, with those of the component in training."""
    if component == CONFIDENCE:  # nothing of the graph is set for it
        return graph_options(spec)
    trained = spec.component(component)
    more = {"--dropout": str(trained.dropout), "--drop-path": str(trained.drop_path)}
    return graph_options(spec) | more


def _intrinsics(camera: Camera) -> str:
    return f"{camera.fx:g},{camera.fy:g},cx,cy@{camera.width}x{camera.height}"


def _origins(origin: dict[str, Any]) -> dict[str, Any]:
    """Where weights began, by option; each plugged component apart."""
    named = {option: origin[name] for name, option in _ORIGIN_OPTIONS.items() if name in origin}
    plugs = origin.get("plug", {})
    return named | {f"--plug {component}": file for component, file in plugs.items()}


def _content(value: object) -> object:
    """The part of a value that is compared: the content of a file."""
    if isinstance(value, dict):
        return value.get("component"), value["sha256"]
    return value.replace(" ", "") if isinstance(value, str) else value


def difference(option: str, value: object, given: object) -> str:
    """An option as it was and as it is given now."""
    return f"{_as_written(option, value)}, given {_as_written(option, given)}"


def _as_written(option: str, value: object) -> str:
    """An option and its value as on the command line; `no OPTION` without one."""
    if value is None or value == "":
        return f"no `{option}`"
    if value is True:
        return f"`{option}`"
    if isinstance(value, dict):
        name, digest = value["file"], value["sha256"][:_DIGITS]
        name = f"{value['component']}={name}" if "component" in value else name
        between = "=" if option.startswith("--plug ") else " "
        return f"`{option}{between}{name}` (SHA-256 {digest}...)"
    return f"`{option} {value}`"
