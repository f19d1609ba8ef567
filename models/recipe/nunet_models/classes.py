"""Label sets: NYU's 40 classes and the 13 of Couprie et al. that the networks predict."""

import numpy as np

CLASSES_13: tuple[str, ...] = (
    "bed",
    "books",
    "ceiling",
    "chair",
    "floor",
    "furniture",
    "objects",
    "picture",
    "sofa",
    "table",
    "tv",
    "wall",
    "window",
)
"""Names of the 13 classes, index = label (Couprie et al., "Indoor Semantic Segmentation using
depth information", 2013)."""

IGNORE = 255
"""Label of a pixel that no loss and no metric counts."""

# fmt: off
_13_FROM_40 = (
    11, 4, 5, 0, 3, 8, 9, 11, 12, 5, 7, 5, 12, 9, 5, 12, 5, 6, 6, 4,
    6, 2, 1, 5, 10, 6, 6, 6, 6, 6, 6, 5, 6, 6, 6, 6, 6, 6, 5,
)
# fmt: on


def labels13_from_labels40(labels40: np.ndarray) -> np.ndarray:
    """Map NYU40 labels (uint8, any shape, 0-based) to the 13 classes (uint8, same shape).

    Label 39 ("otherprop") and everything above becomes `IGNORE`: it is a fifth of
    NYU's pixels and names no one thing.
    """
    table = np.full(256, IGNORE, dtype=np.uint8)
    table[: len(_13_FROM_40)] = _13_FROM_40
    return table[labels40]
