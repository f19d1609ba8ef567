/*
 * nunet.hpp: nunetd's depth, labels and clouds in shared memory, for C++17. Header only, over nunet.h; link libnunet.
 *
 * Objects own the handles of nunet.h, can be moved but not copied, and release their handle in the destructor. Failures
 * are thrown as nunet::Error; a timeout is an empty optional. Views point into shared memory and are valid as long as
 * their frame or loan. For threads, units and forks see nunet.h.
 */
#ifndef NUNET_HPP
#define NUNET_HPP

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "nunet.h"

namespace nunet {

/** A failure: what() is the text with its hint, status() the number. */
class Error : public std::runtime_error {
public:
  Error(nunet_status_t status, const std::string &text) : std::runtime_error(text), status_(status) {}
  nunet_status_t status() const noexcept { return status_; }

private:
  nunet_status_t status_;
};

/** Throws unless `status` is NUNET_OK. */
inline void check(nunet_status_t status) {
  if (status != NUNET_OK) throw Error(status, nunet_last_error());
}

namespace detail {

/** Returns false for a timeout or a signal; throws for any other failure. */
inline bool arrived(nunet_status_t status) {
  if (status == NUNET_TIMEOUT || status == NUNET_INTERRUPTED) return false;
  check(status);
  return true;
}

/** Negative times are 0; times that do not fit are NUNET_FOREVER. */
inline std::uint32_t milliseconds(std::chrono::milliseconds time) {
  if (time.count() <= 0) return 0;
  return time.count() >= static_cast<std::int64_t>(NUNET_FOREVER) ? NUNET_FOREVER
                                                                  : static_cast<std::uint32_t>(time.count());
}

/** One handle, released in the destructor. */
template <typename T, nunet_status_t (*End)(T *)> class Handle {
public:
  Handle() = default;
  explicit Handle(T *handle) noexcept : handle_(handle) {}
  Handle(Handle &&other) noexcept : handle_(other.release()) {}
  Handle &operator=(Handle &&other) noexcept {
    if (this != &other) {
      End(handle_);
      handle_ = other.release();
    }
    return *this;
  }
  Handle(const Handle &) = delete;
  Handle &operator=(const Handle &) = delete;
  ~Handle() { End(handle_); }

  T *get() const noexcept { return handle_; }
  T *release() noexcept { return std::exchange(handle_, nullptr); }

private:
  T *handle_ = nullptr;
};

} // namespace detail

/** A timeout that never ends. */
constexpr std::chrono::milliseconds forever{NUNET_FOREVER};

/** Rows of `width` elements in shared memory, from the top. */
template <typename T> struct View {
  T *data = nullptr;
  std::uint32_t width = 0;
  std::uint32_t height = 0;

  std::size_t size() const noexcept { return static_cast<std::size_t>(width) * height; }
  T *begin() const noexcept { return data; }
  T *end() const noexcept { return data + size(); }
  T *row(std::uint32_t y) const noexcept { return data + static_cast<std::size_t>(y) * width; }
  /** The element in column x of row y; not checked. */
  T &operator()(std::uint32_t x, std::uint32_t y) const noexcept { return row(y)[x]; }
};

/** Elements one after the other in shared memory, such as bytes. */
template <typename T> struct Bytes {
  T *data = nullptr;
  std::size_t size = 0;
  T *begin() const noexcept { return data; }
  T *end() const noexcept { return data + size; }
};

/** One message, read-only; it stays valid while this object lives, also after its reader and its publisher ended. */
class Frame {
public:
  /** No frame; its functions throw. */
  Frame() = default;
  /** Takes ownership of a handle of nunet.h. */
  explicit Frame(nunet_frame_t *handle) noexcept : handle_(handle) {}

  const nunet_header_t &header() const {
    const nunet_header_t *header;
    check(nunet_frame_header(handle_.get(), &header));
    return *header;
  }
  /** The payload of any encoding, aligned to 64 bytes. */
  Bytes<const std::uint8_t> bytes() const {
    const void *data;
    std::size_t size;
    check(nunet_frame_bytes(handle_.get(), &data, &size));
    return {static_cast<const std::uint8_t *>(data), size};
  }
  /** In the header's units (usually meters); NaN where there is no measurement. */
  View<const float> depth() const { return view<const float>(nunet_frame_depth); }
  /** The class of each pixel. */
  View<const std::uint8_t> labels() const { return view<const std::uint8_t>(nunet_frame_labels); }
  View<const std::uint8_t> confidence() const { return view<const std::uint8_t>(nunet_frame_confidence); }
  /** x right, y down, z forward, in the header's units; NaN where there is no measurement. */
  View<const nunet_point_t> points() const { return view<const nunet_point_t>(nunet_frame_points); }
  /** The daemon's counts and latencies. */
  const nunet_stats_t &stats() const {
    const nunet_stats_t *stats;
    check(nunet_frame_stats(handle_.get(), &stats));
    return *stats;
  }
  /** Obstacles around the robot. Only the sectors and points in use mean something. */
  const nunet_obstacles_t &obstacles() const {
    const nunet_obstacles_t *obstacles;
    check(nunet_frame_obstacles(handle_.get(), &obstacles));
    return *obstacles;
  }
  /** The directions of `obstacles()` in use, counterclockwise. */
  Bytes<const nunet_obstacle_sector_t> sectors() const {
    const nunet_obstacles_t &found = obstacles();
    return {found.sectors, found.sector_count};
  }
  /** The points of `obstacles()` in use. */
  Bytes<const nunet_obstacle_point_t> obstacle_points() const {
    const nunet_obstacles_t &found = obstacles();
    return {found.points, found.point_count};
  }
  /** The last samples of the attitude of the robot's base. Only the samples in use mean something. */
  const nunet_attitude_t &attitude() const {
    const nunet_attitude_t *attitude;
    check(nunet_frame_attitude(handle_.get(), &attitude));
    return *attitude;
  }
  /** The samples of `attitude()` in use, oldest first. */
  Bytes<const nunet_attitude_sample_t> attitude_samples() const {
    const nunet_attitude_t &found = attitude();
    return {found.samples, found.sample_count};
  }
  /** The time since capture; empty where the sender knows neither the monotonic clock's time nor the time of day. */
  std::optional<std::chrono::nanoseconds> age() const {
    std::int64_t nanos;
    check(nunet_frame_age(handle_.get(), &nanos));
    if (nanos == INT64_MIN) return std::nullopt;
    return std::chrono::nanoseconds(nanos);
  }
  nunet_frame_t *get() const noexcept { return handle_.get(); }

private:
  template <typename T>
  View<T> view(nunet_status_t (*get)(const nunet_frame_t *, T **, std::uint32_t *, std::uint32_t *)) const {
    View<T> view;
    check(get(handle_.get(), &view.data, &view.width, &view.height));
    return view;
  }

  detail::Handle<nunet_frame_t, nunet_frame_release> handle_;
};

/** Frames of several topics that belong together: all with one sequence number and one capture time. */
class FrameSet {
public:
  /** Takes ownership of the frames of a set of nunet.h. */
  explicit FrameSet(const nunet_set_t &set) noexcept {
    for (std::size_t topic = 0; topic < frames_.size(); topic++) frames_[topic] = Frame(set.frames[topic]);
  }
  bool has(nunet_topic_t topic) const noexcept { return frames_[topic].get() != nullptr; }
  /** The frame of a topic. The functions of a frame whose topic was not opened throw. */
  const Frame &operator[](nunet_topic_t topic) const noexcept { return frames_[topic]; }
  /** Removes the frame of a topic from the set, to keep it longer than the rest. */
  Frame take(nunet_topic_t topic) noexcept { return std::move(frames_[topic]); }

private:
  std::array<Frame, sizeof(nunet_set_t::frames) / sizeof(nunet_frame_t *)> frames_;
};

/** A process; pid 0 when there is none. */
struct Process {
  std::uint32_t pid = 0;
  bool alive = false;
};

/** A reader of some of a camera's topics. */
class Reader {
public:
  /** Waits for the topics (NUNET_BIT_DEPTH | ...) until the timeout. */
  explicit Reader(const std::string &camera, std::uint32_t topic_bits = NUNET_BIT_DEPTH,
                  std::chrono::milliseconds timeout = std::chrono::seconds(5)) {
    nunet_reader_t *reader;
    check(nunet_reader_open(camera.c_str(), topic_bits, detail::milliseconds(timeout), &reader));
    handle_ = decltype(handle_)(reader);
  }
  /** The newest frame of a topic that was not returned yet; empty after the timeout or a signal. */
  std::optional<Frame> next(nunet_topic_t topic, std::chrono::milliseconds timeout) {
    nunet_frame_t *frame;
    if (!detail::arrived(nunet_reader_next(handle_.get(), topic, detail::milliseconds(timeout), &frame))) return {};
    return Frame(frame);
  }
  /** The newest frames of all topics (but stats, attitude) that belong together; empty after the timeout or a signal. */
  std::optional<FrameSet> next_set(std::chrono::milliseconds timeout) {
    nunet_set_t set;
    if (!detail::arrived(nunet_reader_next_set(handle_.get(), detail::milliseconds(timeout), &set))) return {};
    return FrameSet(set);
  }
  /** Sleeps until there may be a new frame. Only a hint, for programs with their own loop. */
  bool wait(std::chrono::milliseconds timeout) {
    bool woken;
    check(nunet_reader_wait(handle_.get(), detail::milliseconds(timeout), &woken));
    return woken;
  }
  /** The process that publishes a topic. */
  Process publisher(nunet_topic_t topic) const {
    Process publisher;
    check(nunet_reader_publisher(handle_.get(), topic, &publisher.pid, &publisher.alive));
    return publisher;
  }
  /** Whether a living process publishes each of the topics. */
  bool is_connected() const noexcept { return nunet_reader_is_connected(handle_.get()); }
  /** Closes it before the destructor; its frames stay valid. */
  void close() { check(nunet_reader_close(handle_.release())); }
  nunet_reader_t *get() const noexcept { return handle_.get(); }

private:
  detail::Handle<nunet_reader_t, nunet_reader_close> handle_;
};

/** An image that is being filled in shared memory; returned unpublished unless it is sent. */
class Loan {
public:
  explicit Loan(nunet_loan_t *handle) noexcept : handle_(handle) {}

  nunet_header_t &header() {
    nunet_header_t *header;
    check(nunet_loan_header(handle_.get(), &header));
    return *header;
  }
  /** The pixels: rows from the top without padding. */
  Bytes<std::uint8_t> bytes() {
    void *data;
    std::size_t size;
    check(nunet_loan_bytes(handle_.get(), &data, &size));
    return {static_cast<std::uint8_t *>(data), size};
  }
  /** Sends it. This object is empty afterwards. */
  void send(std::int64_t capture_nanos, nunet_clock_t clock = NUNET_CLOCK_MONOTONIC) {
    check(nunet_loan_send(handle_.release(), clock, capture_nanos));
  }
  nunet_loan_t *get() const noexcept { return handle_.get(); }

private:
  detail::Handle<nunet_loan_t, nunet_loan_release> handle_;
};

/** A camera that publishes its images. */
class Publisher {
public:
  /** Becomes the publisher of a camera and reserves its memory. max_readers: 0 for the default. */
  Publisher(const std::string &camera, nunet_encoding_t encoding, std::uint32_t width, std::uint32_t height,
            std::uint32_t max_readers = 0) {
    nunet_publisher_t *publisher;
    check(nunet_publisher_open(camera.c_str(), encoding, width, height, max_readers, &publisher));
    handle_ = decltype(handle_)(publisher);
  }
  /** Intrinsics in pixels, and the lens, for all later images. */
  void set_camera(double fx, double fy, double cx, double cy,
                  nunet_distortion_model_t model = NUNET_DISTORTION_MODEL_NONE,
                  const std::vector<double> &coefficients = {}) {
    check(nunet_publisher_set_camera(handle_.get(), fx, fy, cx, cy, model, coefficients.data(), coefficients.size()));
  }
  /** The name of the camera's coordinate frame, for all later images. */
  void set_frame_id(const std::string &name) {
    check(nunet_publisher_set_frame_id(handle_.get(), name.c_str()));
  }
  /** Borrows the memory of the next image, to be filled in place. */
  Loan loan() {
    nunet_loan_t *loan;
    check(nunet_publisher_loan(handle_.get(), &loan));
    return Loan(loan);
  }
  /** Publishes a copy of an image. */
  void publish(const void *bytes, std::size_t byte_count, std::int64_t capture_nanos,
               nunet_clock_t clock = NUNET_CLOCK_MONOTONIC) {
    check(nunet_publisher_publish(handle_.get(), bytes, byte_count, clock, capture_nanos));
  }
  bool has_readers() const noexcept { return nunet_publisher_has_readers(handle_.get()); }
  /** Sends the newest image to readers that opened since; for sources that are paused. */
  void refresh() { check(nunet_publisher_refresh(handle_.get())); }
  /** Closes it before the destructor. */
  void close() { check(nunet_publisher_close(handle_.release())); }
  nunet_publisher_t *get() const noexcept { return handle_.get(); }

private:
  detail::Handle<nunet_publisher_t, nunet_publisher_close> handle_;
};

/** Publishes the attitude of the robot's base for a camera, for `nunetd --attitude shm`. */
class AttitudePublisher {
public:
  /** Becomes the publisher. clock: that of the samples' times. */
  explicit AttitudePublisher(const std::string &camera, nunet_clock_t clock = NUNET_CLOCK_MONOTONIC) {
    nunet_attitude_publisher_t *attitude;
    check(nunet_attitude_open(camera.c_str(), clock, &attitude));
    handle_ = decltype(handle_)(attitude);
  }
  /** Publishes a sample: when it was measured, and rotation about x (forward) and y (left), radians. */
  void publish(std::int64_t capture_nanos, float roll_rad, float pitch_rad) {
    check(nunet_attitude_publish(handle_.get(), capture_nanos, roll_rad, pitch_rad));
  }
  /** Closes it before the destructor. */
  void close() { check(nunet_attitude_close(handle_.release())); }
  nunet_attitude_publisher_t *get() const noexcept { return handle_.get(); }

private:
  detail::Handle<nunet_attitude_publisher_t, nunet_attitude_close> handle_;
};

} // namespace nunet

#endif
