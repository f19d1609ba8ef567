"""Static quantization of a model file to 8-bit integers with onnxruntime."""
