//! Names of classes that several programs must agree on.

/// The 13 classes of NYU Depth V2, index = label: those of the bundled models.
pub const NYU13_CLASSES: [&str; 13] = [
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
];
