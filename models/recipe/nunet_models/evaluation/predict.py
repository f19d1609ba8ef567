"""Runs a model file on images of any size."""

import json
import math
from pathlib import Path

import numpy as np
from PIL import Image

from nunet_models.errors import ConfigError
from nunet_models.evaluation.compare import Predict, Prediction
from nunet_models.export.measure import decoded
from nunet_models.export.onnx_file import read_metadata, session
from nunet_models.zoo.spec import Camera

ENCODINGS = ("metric", "minmax")
"""Encodings of depth that can be compared here."""


class Predictor:
    """Runs a model file with ONNX Runtime on the CPU, one image at a time.

    Images are independent: a recurrent graph starts from a zero state for each. Use `stream` for
    the frames of one video.

    # Errors
    `ConfigError` naming a file that is not a model, damaged, one stage of a graph, or without the
    metadata that a model file must have.
    """

    def __init__(self, path: Path, *, threads: int = 1) -> None:
        self.path = path
        _refuse_stages(path)
        self.metadata = read_metadata(path)
        if self.metadata.get("nunet.version") != "1":
            raise ConfigError(f"`{path}` is not a nunet model file of version 1")
        self.session = session(path, threads=threads)
        inputs = {tensor.name: tensor.shape for tensor in self.session.get_inputs()}
        self.outputs = [tensor.name for tensor in self.session.get_outputs()]
        state = json.loads(self.metadata.get("nunet.state", "[]"))
        self._require_whole(list(inputs), state)
        self.size: tuple[int, int] = tuple(inputs.pop("rgb")[1:3])
        self.state = {name: np.zeros(shape, np.float32) for name, shape in inputs.items()}
        self.state_inputs = {tensor["output"]: tensor["input"] for tensor in state}
        self.architecture = self._stated("nunet.architecture")
        self.encoding = self._stated("nunet.depth.encoding")
        if self.encoding not in ENCODINGS:
            raise ConfigError(
                f"`{path}` outputs depth as `{self.encoding}`; expected {' or '.join(ENCODINGS)}",
                hint="`nunetd eval` measures every encoding",
            )
        self.min_m, self.max_m = self._range_m()

    def _require_whole(self, inputs: list[str], tensors: list[dict[str, str]]) -> None:
        """Refuse a single stage of a graph: expected an image as input and depth as output."""
        state = [tensor["input"] for tensor in tensors]
        if sorted(inputs) != sorted(["rgb", *state]) or "depth" not in self.outputs:
            raise ConfigError(
                f"`{self.path}` takes {_listed(inputs)} and gives {_listed(self.outputs)}; "
                f"expected {_listed(['rgb', *state])} and `depth`",
                hint="a stage of a graph is measured in the fused `.onnx` that computes the same",
            )

    def _stated(self, key: str) -> str:
        """A value of the metadata, which must be there."""
        if key not in self.metadata:
            raise ConfigError(f"`{self.path}` has no `{key}` in its metadata")
        return self.metadata[key]

    def _range_m(self) -> tuple[float, float]:
        """Depth outside is no measurement, meters; NaN for depth that is stretched."""
        if not self.metric:
            return math.nan, math.nan
        low, high = (self._stated(f"nunet.depth.{name}") for name in ("min_m", "max_m"))
        try:
            return float(low), float(high)
        except ValueError as error:
            raise ConfigError(f"the depth range of `{self.path}`: {error}") from error

    @property
    def metric(self) -> bool:
        """Whether depth is in meters; else it is stretched from 0 to 1, per image."""
        return self.encoding == "metric"

    @property
    def classes(self) -> list[str]:
        """Names of the labels; empty where the model gives none."""
        return json.loads(self.metadata.get("nunet.classes", "[]"))

    @property
    def best_epoch(self) -> int | None:
        """The epoch of the last component's training from which the weights are."""
        components = json.loads(self.metadata.get("nunet.components", "[]"))
        training = json.loads(self.metadata.get("nunet.training", "{}"))
        last = components[-1]["name"] if components else "depth"
        return training.get(last, {}).get("epochs_done")

    @property
    def camera(self) -> Camera:
        """The camera that the training images were taken with.

        # Errors
        `ConfigError` naming a file that does not state it: a model file need not.
        """
        text = self._stated("nunet.camera")
        try:
            values = json.loads(text)
            camera = Camera(*(values[name] for name in ("width", "height", "fx", "fy")))
            known = min(camera.width, camera.height, camera.fx, camera.fy) > 0
        except (KeyError, TypeError, ValueError):
            known = False
        if not known:
            raise ConfigError(
                f"`nunet.camera` in the metadata of `{self.path}` is `{text}`; expected width, "
                "height, fx and fy, each more than 0"
            )
        return camera

    def focal_scale(self, fx_px: float, width_px: int) -> float:
        """Factor of depth for a camera of `fx_px` at `width_px`, against the training camera.

        Depth from one image grows with the focal length in pixels, both at one size. Errors as of
        `camera`.
        """
        return (fx_px / width_px) / (self.camera.fx / self.camera.width)

    def inputs(self, rgb: np.ndarray) -> dict[str, np.ndarray]:
        """The session's inputs for an image without predecessor, uint8 `[H, W, 3]`, any size."""
        given = _resized(rgb, self.size, Image.Resampling.BILINEAR)
        return {"rgb": given[None], **self.state}

    def __call__(self, rgb: np.ndarray) -> Prediction:
        """The prediction for an image, uint8 `[H, W, 3]`, at its own size.

        Where the sizes differ the image is resized by PIL's `BILINEAR`, a triangle that grows
        as wide as the image shrinks, and depth back by the same, labels to the nearest. nunetd
        resizes with another kernel (Hermite's), so that its metrics differ slightly for images of
        another size than the model's.
        """
        return self._predicted(rgb, self.inputs(rgb))[0]

    def stream(self) -> Predict:
        """Predicts the frames of one video in order, starting from a zero state.

        As `__call__`, but a recurrent graph gets the state of the previous frame.
        """
        state = self.state

        def predict(rgb: np.ndarray) -> Prediction:
            nonlocal state
            prediction, state = self._predicted(rgb, {**self.inputs(rgb), **state})
            return prediction

        return predict

    def _predicted(
        self, rgb: np.ndarray, inputs: dict[str, np.ndarray]
    ) -> tuple[Prediction, dict[str, np.ndarray]]:
        """The prediction for an image, and the next state by the names of its inputs."""
        image_size = rgb.shape[:2]
        named = dict(zip(self.outputs, self.session.run(None, inputs), strict=True))
        depth = _resized(named["depth"][0, 0], image_size, Image.Resampling.BILINEAR)
        labels = named.get("labels")
        if labels is not None:
            labels = _resized(labels[0], image_size, Image.Resampling.NEAREST)
        confidence = named.get("confidence")
        if confidence is not None:
            confidence = _resized(confidence[0], image_size, Image.Resampling.BILINEAR)
        state = {given: named[output] for output, given in self.state_inputs.items()}
        return Prediction(decoded(depth, self), labels, confidence), state


def _refuse_stages(path: Path) -> None:
    """`export` writes staged graphs as well, which are run by nunetd alone."""
    if path.suffix == ".toml" and path.is_file():
        raise ConfigError(
            f"`{path}` is a staged graph; expected an ONNX file",
            hint=f"the fused `.onnx` computes "
            "the same, and `export --out FILE.onnx` writes it of the same checkpoint; `nunetd eval "
            f"--model {path}` measures the stages themselves",
        )


def _listed(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _resized(array: np.ndarray, size: tuple[int, int], how: Image.Resampling) -> np.ndarray:
    if array.shape[:2] == size:
        return array
    return np.array(Image.fromarray(array).resize(size[::-1], how))
