"""Recipe of nunet's Serial U-Nets: the zoo, its training, evaluation, quantization and export."""

import os

# ONNX Runtime's wheel reports to its vendor unless this is set before onnxruntime is imported; 0
# turns it on.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
