// Gradients of a depth-wise convolution over channels-last bfloat16, 16 channels at a time in registers.
//
// oneDNN has quick kernels for most of a U-Net's training, but falls back to slow ones for the weights of 5x5
// depth-wise layers and for the input of strided ones. There is no padding here: the caller pads.
#include <torch/extension.h>

#include <cstdint>
#include <cstring>
#include <vector>

namespace {

constexpr int64_t LANES = 16;
typedef float Floats __attribute__((vector_size(64)));
typedef uint32_t Words __attribute__((vector_size(64)));
typedef uint16_t Halves __attribute__((vector_size(32)));

inline Floats load(const uint16_t* from) {
    Halves halves;
    std::memcpy(&halves, from, sizeof halves);
    const Words words = __builtin_convertvector(halves, Words) << 16;
    Floats floats;
    std::memcpy(&floats, &words, sizeof floats);
    return floats;
}

// Rounds to the nearest bfloat16, ties to even.
inline void store(uint16_t* to, const Floats& floats) {
    Words words;
    std::memcpy(&words, &floats, sizeof words);
    words = (words + 0x7fff + ((words >> 16) & 1)) >> 16;
    const Halves halves = __builtin_convertvector(words, Halves);
    std::memcpy(to, &halves, sizeof halves);
}

const uint16_t* bytes(const at::Tensor& tensor) { return static_cast<const uint16_t*>(tensor.data_ptr()); }

template <int K>
void weights_of(const at::Tensor& x, const at::Tensor& g, int64_t stride, at::Tensor& out) {
    const int64_t n = x.size(0), c = x.size(1), w = x.size(3), h = x.size(2), oh = g.size(2), ow = g.size(3);
    float* gradient = out.data_ptr<float>();  // [c / 16][K * K][16]
    at::parallel_for(0, c / LANES, 1, [&](int64_t begin, int64_t end) {
        for (int64_t block = begin; block < end; ++block) {
            Floats sums[K * K] = {};
            for (int64_t i = 0; i < n * oh; ++i) {
                const uint16_t* row = bytes(x) + ((i / oh * h + i % oh * stride) * w) * c + block * LANES;
                const uint16_t* above = bytes(g) + i * ow * c + block * LANES;
                for (int64_t column = 0; column < ow; ++column, above += c, row += stride * c) {
                    const Floats slope = load(above);
                    for (int ky = 0; ky < K; ++ky)
                        for (int kx = 0; kx < K; ++kx) sums[ky * K + kx] += load(row + (ky * w + kx) * c) * slope;
                }
            }
            std::memcpy(gradient + block * K * K * LANES, sums, sizeof sums);
        }
    });
}

template <int K>
void input_of(const at::Tensor& weight, const at::Tensor& g, int64_t stride, at::Tensor& out) {
    const int64_t n = out.size(0), c = out.size(1), h = out.size(2), w = out.size(3), oh = g.size(2), ow = g.size(3);
    uint16_t* gradient = static_cast<uint16_t*>(out.data_ptr());
    const float* taps = weight.data_ptr<float>();  // [c / 16][K * K][16]
    at::parallel_for(0, n * (c / LANES), 1, [&](int64_t begin, int64_t end) {
        std::vector<Floats> sums(h * w);
        for (int64_t job = begin; job < end; ++job) {
            const int64_t image = job / (c / LANES), block = job % (c / LANES);
            std::memset(static_cast<void*>(sums.data()), 0, sums.size() * sizeof(Floats));
            Floats kernel[K * K];
            std::memcpy(kernel, taps + block * K * K * LANES, sizeof kernel);
            for (int64_t row = 0; row < oh; ++row) {
                const uint16_t* above = bytes(g) + (image * oh + row) * ow * c + block * LANES;
                for (int64_t column = 0; column < ow; ++column, above += c) {
                    const Floats slope = load(above);
                    Floats* corner = sums.data() + row * stride * w + column * stride;
                    for (int ky = 0; ky < K; ++ky)
                        for (int kx = 0; kx < K; ++kx) corner[ky * w + kx] += kernel[ky * K + kx] * slope;
                }
            }
            uint16_t* to = gradient + image * h * w * c + block * LANES;
            for (int64_t i = 0; i < h * w; ++i) store(to + i * c, sums[i]);
        }
    });
}

}  // namespace

// Gradient of the weights: x [n, c, h, w] and g [n, c, oh, ow], bfloat16 channels-last; float32 [c / 16, k * k, 16].
at::Tensor weight_gradient(const at::Tensor& x, const at::Tensor& g, int64_t k, int64_t stride) {
    auto out = at::empty({x.size(1) / LANES, k * k, LANES}, x.options().dtype(at::kFloat).memory_format(c10::nullopt));
    k == 3 ? weights_of<3>(x, g, stride, out) : weights_of<5>(x, g, stride, out);
    return out;
}

// Gradient of the input: taps float32 [c / 16, k * k, 16], g bfloat16 channels-last, written to `out` alike.
void input_gradient(const at::Tensor& taps, const at::Tensor& g, int64_t k, int64_t stride, at::Tensor out) {
    k == 3 ? input_of<3>(taps, g, stride, out) : input_of<5>(taps, g, stride, out);
}

PYBIND11_MODULE(TORCH_EXTENSION_NAME, m) {
    m.def("weight_gradient", &weight_gradient, py::call_guard<py::gil_scoped_release>());
    m.def("input_gradient", &input_gradient, py::call_guard<py::gil_scoped_release>());
}
