"""From linear light to the JPEG of a small camera: exposure, white balance, blur, noise."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import numpy as np
from PIL import Image, ImageFilter

TARGET_GRAY = 0.2
"""Linear value to which auto exposure brings the mean of the image's means (see `Metered`)."""


@dataclass(frozen=True)
class Metered:
    """What a camera's automatic exposure and white balance see."""

    brightness: float
    means: np.ndarray
    """Mean of each channel, `[3]`."""

    @classmethod
    def of(cls, linear: np.ndarray) -> Metered:
        """Meter an image, `[H, W, 3]`; lamps and shadows both count."""
        light = np.nan_to_num(np.clip(linear, 0, 1e4)).astype(np.float64)
        gray = light.mean(axis=2) + 1e-6
        # Lamps and black corners count, but only up to a limit.
        gray = gray.clip(np.median(gray) / 100, np.median(gray) * 20)
        # Geometric mean of the arithmetic and the geometric mean.
        brightness = np.sqrt(gray.mean() * np.exp(np.log(gray).mean()))
        return cls(float(brightness), light.mean(axis=(0, 1)))

    @classmethod
    def mean(cls, several: list[Metered]) -> Metered:
        """The mean over several images, as a camera that adapts slowly."""
        logs = np.log([each.brightness for each in several])
        return cls(float(np.exp(logs.mean())), np.mean([each.means for each in several], axis=0))


@dataclass(frozen=True)
class Sensor:
    """The faults of one camera; all random numbers are drawn when it is made."""

    exposure_stops: float
    white_balance: float
    """0 keeps the light's color, 1 makes the image gray on average."""
    shoulder: float
    """0 clips highlights, 1 compresses them as film does."""
    contrast: float
    saturation: float
    noise: float
    """Factor on a small sensor's noise."""
    blur_px: float
    vignette: float
    quality: int

    @classmethod
    def draw(cls, random: Random) -> Sensor:
        """A random camera; most are good."""
        bad_exposure = random.random() < 0.2
        return cls(
            exposure_stops=random.gauss(0.15, 0.8 if bad_exposure else 0.3),
            white_balance=random.uniform(0.1, 0.9),
            shoulder=random.choice((0.0, 0.4, 0.8, 1.0)),
            contrast=random.uniform(0.85, 1.25),
            saturation=random.uniform(0.75, 1.25),
            noise=random.choice((0.2, 0.4, 0.7, 1.0, 1.8)),
            blur_px=random.choice((0.0, 0.0, 0.0, 0.3, 0.5, 0.8, 1.2)),
            vignette=random.uniform(0, 0.3),
            quality=random.randint(82, 95),
        )

    def develop(
        self, linear: np.ndarray, random: np.random.Generator, metered: Metered | None = None
    ) -> Image.Image:
        """`[H, W, 3]` float, linear RGB of any scale, as the camera's 8-bit image.

        `metered` is what exposure and white balance go by; by default the image itself.
        """
        metered = metered or Metered.of(linear)
        light = np.nan_to_num(np.clip(linear, 0, 1e4)).astype(np.float32)
        gain = TARGET_GRAY / metered.brightness * 2.0**self.exposure_stops
        means = metered.means + 1e-6
        balance = ((means.mean() / means) ** self.white_balance).astype(np.float32)
        light = light * gain * balance.clip(0.3, 3)
        light = _vignetted(light, self.vignette)
        # Dark rooms need a high gain, and gain amplifies noise.
        light = _noisy(light, self.noise * float(np.clip(gain, 0.7, 2.5)), random)
        curved = (1 - self.shoulder) * light.clip(0, 1) + self.shoulder * _filmic(light)
        gray = curved.mean(axis=2, keepdims=True)
        curved = (gray + self.saturation * (curved - gray)).clip(0, 1)
        encoded = curved ** (1 / 2.2)
        encoded = ((encoded - 0.45) * self.contrast + 0.45).clip(0, 1)
        image = Image.fromarray((encoded * 255 + 0.5).astype(np.uint8))
        return image.filter(ImageFilter.GaussianBlur(self.blur_px)) if self.blur_px else image


def _filmic(light: np.ndarray) -> np.ndarray:
    """A film's curve (Narkowicz's fit of ACES), 0 to 1."""
    x = light * 0.8
    return (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clip(0, 1)


def _vignetted(light: np.ndarray, strength: float) -> np.ndarray:
    height, width = light.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    radius2 = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / (width**2 / 4 + height**2 / 4)
    return light * (1 - strength * radius2)[:, :, None]


def _noisy(light: np.ndarray, factor: float, random: np.random.Generator) -> np.ndarray:
    """Shot and read noise; color noise is coarser, since Bayer sensors interpolate color."""
    height, width = light.shape[:2]
    deviation = factor * np.sqrt(1.2e-4 * light.clip(0, 4) + 1e-6)
    common = random.standard_normal((height, width, 1), np.float32)
    own = random.standard_normal((height // 2 + 1, width // 2 + 1, 3), np.float32)
    own = own.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return (light + deviation * (0.9 * common + 0.35 * own)).clip(0, None)
