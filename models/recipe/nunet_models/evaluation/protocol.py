"""Crops and caps of the usual evaluation protocols."""

from dataclasses import dataclass

import numpy as np

from nunet_models.errors import DataError

MIN_DEPTH_M = 1e-3  # predictions below would make relative errors meaningless; the usual value
MAX_DEPTH_M = 10.0  # truth beyond this is ignored, as in the code of BTS, AdaBins and ZoeDepth


@dataclass(frozen=True)
class Protocol:
    """A crop (top, left, bottom, right) in pixels of images of `size`, and a cap in meters."""

    name: str
    crop: tuple[int, int, int, int] | None = None
    size: tuple[int, int] | None = None
    cap_m: float = MAX_DEPTH_M

    def predicted(self, depth_m: np.ndarray) -> np.ndarray:
        """Predicted depth `[H, W]` in meters, cropped and capped; NaN stays NaN."""
        return np.clip(self.cropped(depth_m), MIN_DEPTH_M, self.cap_m)

    def truth(self, depth_m: np.ndarray) -> np.ndarray:
        """True depth `[H, W]` in meters, cropped; NaN where it is not within the cap."""
        truth = self.cropped(depth_m)
        return np.where((truth > MIN_DEPTH_M) & (truth < self.cap_m), truth, np.float32(np.nan))

    def beyond(self, depth_m: np.ndarray) -> int:
        """Number of pixels of true depth `[H, W]` in meters that the cap excludes."""
        known = np.isfinite(self.cropped(depth_m))
        return int(known.sum() - np.isfinite(self.truth(depth_m)).sum())

    def cropped(self, image: np.ndarray) -> np.ndarray:
        """`[H, W]` cropped.

        # Errors
        `DataError` when the image does not have the size of the protocol.
        """
        if self.crop is None:
            return image
        if image.shape != self.size:
            raise DataError(
                f"protocol `{self.name}` is for images of {self.size}; this one is {image.shape}",
                hint="`--protocol full`",
            )
        top, left, bottom, right = self.crop
        return image[top:bottom, left:right]


EIGEN = Protocol("eigen", crop=(45, 41, 471, 601), size=(480, 640))
"""The crop of Eigen et al. 2014 on NYU Depth V2, used by nearly every paper since."""
FULL = Protocol("full")

PROTOCOLS = {protocol.name: protocol for protocol in (EIGEN, FULL)}
