// classes CAMERA OWN: ownership, moves, exceptions and release of the objects of nunet.hpp. A running nunetd publishes
// CAMERA; no process publishes OWN.
#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <type_traits>

#include "nunet.hpp"

using namespace std::chrono_literals;

static int failures = 0;

#define HOLDS(condition) holds(__LINE__, #condition, (condition))

static void holds(int line, const char *condition, bool found) {
  if (found) return;
  failures++;
  std::cout << "line " << line << ": " << condition << " does not hold\n";
}

template <typename Call> static nunet_status_t status_of(Call call) {
  try {
    call();
  } catch (const nunet::Error &error) {
    HOLDS(*error.what() != 0);
    return error.status();
  }
  return NUNET_OK;
}

static_assert(!std::is_copy_constructible<nunet::Frame>::value, "frames are moved");
static_assert(std::is_nothrow_move_constructible<nunet::Reader>::value, "readers are moved");
static_assert(std::is_base_of<std::runtime_error, nunet::Error>::value, "errors are standard exceptions");

static void reading(const std::string &camera) {
  std::optional<nunet::Frame> kept;
  std::uint64_t sequence = 0;
  {
    nunet::Reader first(camera, NUNET_BIT_DEPTH | NUNET_BIT_LABELS | NUNET_BIT_CLOUD, 30s);
    nunet::Reader reader = std::move(first);
    HOLDS(first.get() == nullptr && reader.is_connected() && reader.publisher(NUNET_TOPIC_DEPTH).alive);
    HOLDS(status_of([&] { first.next(NUNET_TOPIC_DEPTH, 0ms); }) == NUNET_BAD_ARGUMENT);
    auto set = reader.next_set(30s);
    HOLDS(set.has_value() && set->has(NUNET_TOPIC_CLOUD) && !set->has(NUNET_TOPIC_RGB));
    const auto points = (*set)[NUNET_TOPIC_CLOUD].points();
    const auto depth = (*set)[NUNET_TOPIC_DEPTH].depth();
    HOLDS(points.size() == depth.size() && (*set)[NUNET_TOPIC_LABELS].labels().size() == depth.size());
    HOLDS(&depth(1, 2) == depth.begin() + 2 * depth.width + 1);
    HOLDS(std::any_of(depth.begin(), depth.end(), [](float meters) { return meters > 0; }));
    HOLDS(status_of([&] { (*set)[NUNET_TOPIC_DEPTH].labels(); }) == NUNET_WRONG_ENCODING);
    HOLDS(status_of([&] { (*set)[NUNET_TOPIC_RGB].header(); }) == NUNET_BAD_ARGUMENT);
    nunet::FrameSet moved = std::move(*set);
    HOLDS(!set->has(NUNET_TOPIC_DEPTH) && moved.has(NUNET_TOPIC_DEPTH));
    *set = std::move(moved);
    kept = set->take(NUNET_TOPIC_DEPTH);
    HOLDS(!set->has(NUNET_TOPIC_DEPTH) && kept->age() > 0ns);
    sequence = kept->header().sequence;
    // Dropped frames are released: more are read than may be held at a time.
    for (int count = 0; count < 5; count++) {
      auto next = reader.next(NUNET_TOPIC_LABELS, 30s);
      HOLDS(next && next->header().sequence > sequence);
    }
  }
  HOLDS(kept->header().sequence == sequence && kept->bytes().size == kept->depth().size() * 4);
}

static void publishing(const std::string &own) {
  nunet::Publisher publisher(own, NUNET_ENCODING_MONO8, 8, 2);
  HOLDS(status_of([&] { nunet::Publisher second(own, NUNET_ENCODING_MONO8, 8, 2); }) == NUNET_ALREADY_PUBLISHED);
  publisher.set_camera(10, 11, 3.5, 0.5, NUNET_DISTORTION_MODEL_KANNALA_BRANDT, {0.5, 0, 0, 0});
  publisher.set_frame_id("optical");
  nunet::Reader reader(own, NUNET_BIT_RGB, 30s);
  HOLDS(publisher.has_readers() && !reader.next(NUNET_TOPIC_RGB, 0ms));
  { publisher.loan(); } // dropped without sending
  auto loan = publisher.loan();
  HOLDS(status_of([&] { publisher.loan(); }) == NUNET_TOO_MANY_LOANS);
  auto bytes = loan.bytes();
  std::fill(bytes.begin(), bytes.end(), std::uint8_t{42});
  loan.send(5, NUNET_CLOCK_MEDIA);
  HOLDS(status_of([&] { loan.header(); }) == NUNET_BAD_ARGUMENT);
  auto frame = reader.next(NUNET_TOPIC_RGB, 30s);
  HOLDS(frame && frame->bytes().size == 16 && frame->bytes().data[15] == 42);
  // A position in a recording has no time of day, so the header has the time of sending.
  HOLDS(frame && frame->header().capture_nanos == 5 && frame->header().capture_unix_nanos > 946684800000000000);
  HOLDS(frame && frame->header().fy == 11 && std::string(frame->header().frame_id) == "optical");
  auto old = publisher.loan();
  old.send(nunet_monotonic_nanos() - 5000000000, NUNET_CLOCK_MONOTONIC);
  auto late = reader.next(NUNET_TOPIC_RGB, 30s);
  HOLDS(late && late->age() >= 5s); // since its capture, not since it was sent
  reader.close();
  publisher.close();
  HOLDS(status_of([&] { reader.wait(0ms); }) == NUNET_BAD_ARGUMENT);
}

static void attitude(const std::string &own) {
  nunet::AttitudePublisher publisher(own);
  HOLDS(status_of([&] { nunet::AttitudePublisher second(own); }) == NUNET_ALREADY_PUBLISHED);
  nunet::Reader reader(own, NUNET_BIT_ATTITUDE, 30s);
  HOLDS(status_of([&] { publisher.publish(1, 90, 0); }) == NUNET_BAD_ARGUMENT); // degrees
  HOLDS(status_of([&] { publisher.publish(-1, 0, 0); }) == NUNET_BAD_ARGUMENT);
  publisher.publish(1, 0.25f, 0);
  publisher.publish(2, 0, -0.5f);
  auto frame = reader.next(NUNET_TOPIC_ATTITUDE, 30s);
  HOLDS(frame && frame->attitude().sample_count == 2);
  const auto samples = frame ? frame->attitude_samples() : nunet::Bytes<const nunet_attitude_sample_t>{};
  HOLDS(samples.size == 2 && samples.data[0].roll_rad == 0.25f);
  HOLDS(samples.size == 2 && samples.data[1].capture_nanos == 2 && samples.data[1].pitch_rad == -0.5f);
  HOLDS(frame && status_of([&] { frame->depth(); }) == NUNET_WRONG_ENCODING);
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  HOLDS(status_of([] { nunet::Reader("nobody-has-this-name", NUNET_BIT_DEPTH, 20ms); }) == NUNET_NOBODY_PUBLISHES);
  reading(argv[1]);
  publishing(argv[2]);
  attitude(argv[2]);
  std::cout << failures << " failures\n";
  return failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
