// Reads depth and labels from a running nunetd: subscribe CAMERA [FRAMES]. How to compile it: docs/book/shared-memory.md.
//
// Prints each frame's sequence number, the time since its capture, and depth and class at the center of the image.
#include <cstdlib>
#include <iomanip>
#include <iostream>

#include "nunet.hpp"

int main(int argc, char **argv) try {
  using namespace std::chrono_literals;
  const std::string camera = argc > 1 ? argv[1] : "demo";
  long frames = argc > 2 ? std::atol(argv[2]) : 100;

  nunet::Reader reader(camera, NUNET_BIT_DEPTH | NUNET_BIT_LABELS, 10s);
  while (frames > 0) {
    auto set = reader.next_set(1s);
    if (!set) {
      std::cerr << nunet_last_error() << '\n'; // frames of the next publisher will arrive here
      continue;
    }
    const nunet::Frame &frame = (*set)[NUNET_TOPIC_DEPTH];
    const auto depth = frame.depth(); // a view of shared memory, valid as long as the set
    const auto labels = (*set)[NUNET_TOPIC_LABELS].labels();
    const auto x = depth.width / 2, y = depth.height / 2;
    const auto age_ms = std::chrono::duration<double, std::milli>(frame.age().value_or(0ns)).count();
    std::cout << "frame " << frame.header().sequence << std::fixed << std::setprecision(2) << ": captured " << age_ms
              << " ms ago, center " << std::setprecision(3) << depth(x, y) << ", class " << int(labels(x, y)) << '\n';
    frames--;
  }
} catch (const nunet::Error &error) {
  std::cerr << "error: " << error.what() << '\n';
  return EXIT_FAILURE;
}
