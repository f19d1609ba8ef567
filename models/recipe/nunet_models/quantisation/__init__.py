"""Integer arithmetic: static quantisation of a model file with onnxruntime."""
