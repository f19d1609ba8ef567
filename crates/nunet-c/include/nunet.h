/*
 * nunet.h: nunetd's depth, labels and clouds in shared memory, for C (C99) and C++.
 *
 * Written by crates/nunet-c/tests/header.rs; change the source, not this file.
 *
 * RESULTS. Functions return NUNET_OK (0) or a status; nunet_last_error() returns the error's text with a hint. No
 * function exits, throws or prints, except that a bug in the library prints where it happened.
 * docs/book/shared-memory.md shows how to compile and link.
 *
 * OWNERSHIP. Handles (reader, frame, publisher, loan) belong to the caller until closed, released or sent. Using a
 * handle after that, or one of another kind, is an error (NUNET_CLOSED), not a crash. Memory of a frame or a loan belongs
 * to the library and is valid until the frame or loan is released or sent. Strings and arrays that you pass in are copied;
 * strings must end with a zero byte, and arrays must have the length that you state.
 *
 * NULL. Pointers to results must not be NULL unless the description allows it. After a failure, returned handles and
 * pointers are NULL.
 *
 * THREADS. Any thread may call any function. Calls with the same reader or publisher run one after the other. Any
 * thread may read a frame, and release it when no other thread uses it. Do not call these functions in signal handlers.
 *
 * FORK. Open after forking: handles opened before belong to the parent, and return NUNET_FORKED in the child.
 *
 * UNITS. Depth in meters where the header's `units` says so, NaN where there is no measurement; times in
 * nanoseconds, timeouts in milliseconds, sizes and intrinsics in pixels.
 *
 * END. Close all handles before the process ends. The next process that opens the camera cleans up after a killed one.
 */

#ifndef NUNET_H
#define NUNET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** Version of the library that this header belongs to. */
#define NUNET_VERSION "0.1.0"

/** Version of the shared-memory contract. */
#define NUNET_CONTRACT_VERSION 1

/** A timeout that never ends. */
#define NUNET_FOREVER UINT32_MAX

/** Stages whose times fit into a header. */
#define NUNET_MAX_STAGES 16

/** Coefficients that a distortion model may have. */
#define NUNET_MAX_COEFFICIENTS 14

/** Bytes of a stage's name. */
#define NUNET_STAGE_NAME_BYTES 32

/** The label of a point that has no class. */
#define NUNET_NO_LABEL 255

/** Sectors that an obstacle record has room for. */
#define NUNET_MAX_SECTORS 360

/** Points that an obstacle record has room for. */
#define NUNET_MAX_OBSTACLE_POINTS 5000

/** Samples that an attitude record has room for. */
#define NUNET_MAX_ATTITUDE_SAMPLES 256

/** Values of the header's field `topic`. */
typedef enum nunet_topic_t {
  /** The camera's image, in the encoding of a pixel format. */
  NUNET_TOPIC_RGB = 0,
  /** The depth map: `[height, width]`, `float`, NaN where there is no measurement. */
  NUNET_TOPIC_DEPTH = 1,
  /** The class of each pixel: `[height, width]`, `uint8_t`. */
  NUNET_TOPIC_LABELS = 2,
  /** The organized point cloud: `[height, width]` points of 16 bytes. */
  NUNET_TOPIC_CLOUD = 3,
  /** Obstacles around the robot, by direction and as points: one obstacle record. */
  NUNET_TOPIC_OBSTACLES = 4,
  /** The daemon's counts and latencies: one stats record. */
  NUNET_TOPIC_STATS = 5,
  /** The confidence of depth: `[height, width]`, `uint8_t`, 255 = certain, 0 where there is no measurement. */
  NUNET_TOPIC_CONFIDENCE = 6,
  /** The attitude of the robot's base, from an inertial sensor, for the daemon: one attitude record. */
  NUNET_TOPIC_ATTITUDE = 7,
} nunet_topic_t;

/** Values of the header's field `encoding`. */
typedef enum nunet_encoding_t {
  /** `[height, width, 3]` bytes: red, green, blue. */
  NUNET_ENCODING_RGB8 = 0,
  /** `[height, width, 3]` bytes: blue, green, red. */
  NUNET_ENCODING_BGR8 = 1,
  /** `[height, width]` bytes of brightness. */
  NUNET_ENCODING_MONO8 = 2,
  /** `[height, width / 2, 4]` bytes: Y0, U, Y1, V. */
  NUNET_ENCODING_YUYV = 3,
  /** `[height, width]` bytes of Y, then `[height / 2, width / 2, 2]` of U, V. */
  NUNET_ENCODING_NV12 = 4,
  /** `[height, width]` little-endian `float`. */
  NUNET_ENCODING_DEPTH_F32 = 5,
  /** `[height, width]` class indices. */
  NUNET_ENCODING_LABELS_U8 = 6,
  /** `[height, width]` points of 16 bytes. */
  NUNET_ENCODING_POINTS = 7,
  /** One stats record. */
  NUNET_ENCODING_STATS_RECORD = 8,
  /** One obstacle record. */
  NUNET_ENCODING_OBSTACLE_RECORD = 9,
  /** `[height, width]` bytes, 255 = certain. */
  NUNET_ENCODING_CONFIDENCE_U8 = 10,
  /** One attitude record. */
  NUNET_ENCODING_ATTITUDE_RECORD = 11,
} nunet_encoding_t;

/** Values of the header's field `units`. */
typedef enum nunet_units_t {
  /** The payload is not a distance. */
  NUNET_UNITS_NONE = 0,
  /** Meters. */
  NUNET_UNITS_METRE = 1,
  /** No unit: larger values are farther. */
  NUNET_UNITS_RELATIVE = 2,
} nunet_units_t;

/** Values of the header's field `scale_source`. */
typedef enum nunet_scale_source_t {
  /** The network's own meters, unchanged. */
  NUNET_SCALE_SOURCE_METRIC = 0,
  /** The network's meters times the ratio of this camera's focal length to the training camera's. */
  NUNET_SCALE_SOURCE_FOCAL_SCALED = 1,
  /** The network's meters, unchanged, because this camera's focal length is unknown. */
  NUNET_SCALE_SOURCE_ASSUMED_CAMERA = 2,
  /** There is no scale. */
  NUNET_SCALE_SOURCE_RELATIVE = 3,
  /** The network's meters times a factor that was measured for this camera. */
  NUNET_SCALE_SOURCE_CALIBRATED = 4,
  /** The network's meters times a factor that follows from the floor and the camera's height above it. */
  NUNET_SCALE_SOURCE_FLOOR = 5,
} nunet_scale_source_t;

/** Values of the header's field `capture_clock`. */
typedef enum nunet_clock_t {
  /** `CLOCK_MONOTONIC` of this machine. */
  NUNET_CLOCK_MONOTONIC = 0,
  /** Nanoseconds since 1970-01-01 UTC. */
  NUNET_CLOCK_UNIX = 1,
  /** The position in a recording. */
  NUNET_CLOCK_MEDIA = 2,
} nunet_clock_t;

/** Values of the header's field `distortion_model`. */
typedef enum nunet_distortion_model_t {
  /** A pinhole: no coefficients. */
  NUNET_DISTORTION_MODEL_NONE = 0,
  /** Brown-Conrady: k1 k2 p1 p2 k3 k4 k5 k6, then s1 to s4 and the two tilts. */
  NUNET_DISTORTION_MODEL_BROWN_CONRADY = 1,
  /** Kannala-Brandt (fisheye): k1 to k4. */
  NUNET_DISTORTION_MODEL_KANNALA_BRANDT = 2,
} nunet_distortion_model_t;

/** Values of the header's field `quality`. */
typedef enum nunet_quality_t {
  /** Every stage. */
  NUNET_QUALITY_FULL = 0,
  /** The labels come from an earlier frame. */
  NUNET_QUALITY_REUSED_LABELS = 1,
} nunet_quality_t;

/** Values of a sector's field `state`. */
typedef enum nunet_sector_state_t {
  /** Not known: floor not visible, no valid depth, outside the view, glass, mirror or screen. Never
      free. */
  NUNET_SECTOR_STATE_UNKNOWN = 0,
  /** Nothing: the floor is seen and empty up to `range_m`. */
  NUNET_SECTOR_STATE_FREE = 1,
  /** An obstacle at `range_m`. */
  NUNET_SECTOR_STATE_OCCUPIED = 2,
  /** The floor ends at `range_m`: stairs, an edge. */
  NUNET_SECTOR_STATE_DROP = 3,
} nunet_sector_state_t;

/** What a reader opens: a sum of these. */
typedef enum nunet_bit_t {
  NUNET_BIT_RGB = 1,
  NUNET_BIT_DEPTH = 2,
  NUNET_BIT_LABELS = 4,
  NUNET_BIT_CLOUD = 8,
  NUNET_BIT_OBSTACLES = 16,
  NUNET_BIT_STATS = 32,
  NUNET_BIT_CONFIDENCE = 64,
  NUNET_BIT_ATTITUDE = 128,
} nunet_bit_t;

/**
 * The header of a message, as stored in shared memory.
 * `nunet.v1.FrameHeader`, 1024 bytes.
 */
typedef struct nunet_header_t {
  /** `NUNET_CONTRACT_VERSION`. */
  uint32_t contract_version;
  /** A `nunet_topic_t`. */
  uint32_t topic;
  /** The frame's number: the same in every topic of one frame. It increases from an arbitrary start. */
  uint64_t sequence;
  /** The capture time, in nanoseconds of `capture_clock`: the same in every topic of one frame. */
  int64_t capture_nanos;
  /** The capture time, in nanoseconds since 1970-01-01 UTC; 0 when unknown. */
  int64_t capture_unix_nanos;
  /** When this message was sent, nanoseconds of `CLOCK_MONOTONIC`. */
  int64_t publish_nanos;
  /** A `nunet_clock_t`. */
  uint32_t capture_clock;
  /** A `nunet_encoding_t`. */
  uint32_t encoding;
  /** Columns of the payload, in pixels or points. */
  uint32_t width;
  /** Rows of the payload. */
  uint32_t height;
  /** Bytes from one row to the next. */
  uint32_t row_stride_bytes;
  /** A `nunet_units_t`. */
  uint32_t units;
  /** Bytes of the payload, without the unused end of the last block. */
  uint64_t payload_bytes;
  /** A `nunet_scale_source_t`; without meaning when `units` is none. */
  uint32_t scale_source;
  /** A `nunet_quality_t`. */
  uint32_t quality;
  /** Focal length in pixels at `width` x `height`; 0 when the camera is not known. */
  double fx;
  /** Focal length in pixels, vertically. */
  double fy;
  /** Principal point in pixels; the center of the first pixel is 0. */
  double cx;
  /** Principal point in pixels, vertically. */
  double cy;
  /** The coefficients of `distortion_model`, padded with zeros. */
  double distortion[NUNET_MAX_COEFFICIENTS];
  /** A `nunet_distortion_model_t`. */
  uint32_t distortion_model;
  /** How many of `stage_micros` are in use; the stages' names are in the `stats` topic. */
  uint32_t stage_count;
  /** SHA-256 of the model; zeros in a camera's own images. */
  uint8_t model_hash[32];
  /** Microseconds that each stage took for this frame. */
  uint32_t stage_micros[NUNET_MAX_STAGES];
  /** Bytes copied for this frame: for the network's input, for reused labels, and for resized results. */
  uint64_t bytes_copied;
  /** Pixels of the depth map without a depth, after the filters: those that are NaN. */
  uint64_t invalid_pixels;
  /** The name of the camera's coordinate frame, UTF-8, padded with zeros. */
  char frame_id[64];
  /** Factor by which the network's meters were multiplied; 0 if unknown or without meaning. */
  double scale_factor;
  /** Nanoseconds since `scale_factor` was measured; 0 for one that does not change. */
  int64_t scale_age_nanos;
  /** The part of the camera's image that this message covers: its first column, pixels of the image. */
  uint32_t view_x;
  /** The first row. */
  uint32_t view_y;
  /** Columns; 0 if the part is unknown, and in images. */
  uint32_t view_width;
  /** Rows; 0 if the part is unknown, and in images. */
  uint32_t view_height;
  /** Zero; room for later fields. */
  uint8_t reserved[584];
} nunet_header_t;

/**
 * The daemon's stats: counts of frames, rates, and latencies in microseconds.
 * `captured = published + superseded + failed + in_flight`, always.
 * `nunet.v1.StatsRecord`, 2560 bytes.
 */
typedef struct nunet_stats_t {
  /** `NUNET_CONTRACT_VERSION`. */
  uint32_t contract_version;
  /** How many stages there are. */
  uint32_t stage_count;
  /** Frames that the source delivered. */
  uint64_t captured;
  /** Frames whose depth was published. */
  uint64_t published;
  /** Frames that a newer one replaced before they were processed. */
  uint64_t superseded;
  /** Frames that ended with an error. */
  uint64_t failed;
  /** Frames that have not ended yet. */
  uint64_t in_flight;
  /** Published frames a second, since the first one. */
  double fps;
  /** Mean bytes copied, a frame. */
  double bytes_copied_per_frame;
  /** Mean heap allocations of our crates, a frame; NaN when they are not counted. */
  double allocations_per_frame;
  /** The median time from the image's arrival at the daemon to publication. */
  double total_p50_us;
  /** The 90th percentile. */
  double total_p90_us;
  /** The 99th percentile. */
  double total_p99_us;
  /** The slowest frame. */
  double total_max_us;
  /** The mean. */
  double total_mean_us;
  /** SHA-256 of the model. */
  uint8_t model_hash[32];
  /** The model file's name, UTF-8, padded with zeros. */
  char model_name[64];
  /** The execution provider, UTF-8, padded with zeros. */
  char provider[32];
  /** The stages' names in the order of `stage_micros`. */
  char stage_names[NUNET_MAX_STAGES][NUNET_STAGE_NAME_BYTES];
  /** Each stage's median. */
  double stage_p50_us[NUNET_MAX_STAGES];
  /** Each stage's 90th percentile. */
  double stage_p90_us[NUNET_MAX_STAGES];
  /** Each stage's 99th percentile. */
  double stage_p99_us[NUNET_MAX_STAGES];
  /** Each stage's slowest run. */
  double stage_max_us[NUNET_MAX_STAGES];
  /** Each stage's mean. */
  double stage_mean_us[NUNET_MAX_STAGES];
  /** 1 if `depth_drift` and `depth_flicker` are known, 0 if not: the image changes. */
  uint32_t has_stability;
  /** 1 while drift or flicker is above the daemon's limit. */
  uint32_t is_unstable;
  /** Growth of the depth's scale per frame, mean of the last frames; 0.01 is one percent. */
  double depth_drift;
  /** Change of points per frame beside the scale, mean of the last frames; 0.01 is one percent. */
  double depth_flicker;
  /** Zero; room for later fields. */
  uint8_t reserved[1144];
} nunet_stats_t;

/**
 * A point of a cloud, in the camera's optical frame: x right, y down, z forward.
 * `nunet.v1.Point`, 16 bytes.
 */
typedef struct nunet_point_t {
  /** Meters to the right; NaN where depth has no measurement. */
  float x;
  /** Meters down. */
  float y;
  /** Meters forward. */
  float z;
  /** Blue. */
  uint8_t b;
  /** Green. */
  uint8_t g;
  /** Red. */
  uint8_t r;
  /** The class; 255 where there is none. */
  uint8_t label;
} nunet_point_t;

/**
 * One direction of the robot, in the leveled base frame: x forward, y left, origin on the floor.
 * `nunet.v1.ObstacleSector`, 32 bytes.
 */
typedef struct nunet_obstacle_sector_t {
  /** Meters from the base's origin up to which the direction is free; what is there is `state`. Nearer
      than `seen_from_m` nothing was seen. */
  float range_m;
  /** Meters to the nearest obstacle, also where `state` is another; NaN if none was seen. */
  float obstacle_m;
  /** Lowest point of the nearest obstacle, meters above ground; NaN without obstacle. */
  float min_height_m;
  /** Highest point of the nearest obstacle, meters above ground; NaN without obstacle. */
  float max_height_m;
  /** Meters to the nearest floor that the camera can see in this direction; NaN if it sees none. */
  float seen_from_m;
  /** Seconds since the obstacle was seen; 0 unless `remembered`. */
  float age_s;
  /** A `nunet_sector_state_t`. */
  uint32_t state;
  /** The class of the nearest obstacle; 255 where there is none. */
  uint8_t label;
  /** 1 if the obstacle was seen in an earlier frame and left the image at the bottom, else 0. */
  uint8_t remembered;
  /** Zero; room for later fields. */
  uint8_t reserved[2];
} nunet_obstacle_sector_t;

/**
 * A point of an obstacle, in the leveled base frame: x forward, y left, z up, origin on the floor.
 * `nunet.v1.ObstaclePoint`, 20 bytes.
 */
typedef struct nunet_obstacle_point_t {
  /** Meters forward. */
  float x;
  /** Meters to the left. */
  float y;
  /** Meters up. */
  float z;
  /** Meters above the ground at this place. */
  float height;
  /** The class; 255 where there is none. */
  uint8_t label;
  /** 255 = certain; 255 as well where the network has no confidence. */
  uint8_t confidence;
  /** Zero; room for later fields. */
  uint8_t reserved[2];
} nunet_obstacle_point_t;

/**
 * The obstacles of one frame, in the leveled base frame.
 * `nunet.v1.ObstacleRecord`, 111680 bytes.
 */
typedef struct nunet_obstacles_t {
  /** `NUNET_CONTRACT_VERSION`. */
  uint32_t contract_version;
  /** How many of `sectors` are in use. */
  uint32_t sector_count;
  /** How many of `points` are in use. */
  uint32_t point_count;
  /** 1 if the ground was measured in this frame, 0 if it is the plane that follows from the mount. */
  uint32_t ground_refined;
  /** 1 if labels identified floor and glass, 0 if only geometry did. */
  uint32_t used_labels;
  /** The right boundary of the first sector, radians, counterclockwise from x; the sectors follow
      counterclockwise. */
  float angle_min_rad;
  /** The width of a sector, radians. */
  float angle_step_rad;
  /** Height above the ground that the robot can drive over, meters. */
  float clearance_m;
  /** Height above the ground that the robot can drive under, meters. */
  float robot_height_m;
  /** Obstacles farther from the base are ignored, meters. */
  float max_range_m;
  /** The share of the image that shows floor, 0 to 1. */
  float floor_fraction;
  /** The ground: rise per meter forward. */
  float ground_slope_x;
  /** The ground: rise per meter to the left. */
  float ground_slope_y;
  /** The ground: height at the origin, meters. */
  float ground_height_m;
  /** 1 if the mount was turned by the robot's attitude at the capture time, 0 if the robot counts as
      level. */
  uint32_t used_attitude;
  /** Zero; room for later fields. */
  uint8_t reserved[100];
  /** The directions. Unused entries are undefined. */
  nunet_obstacle_sector_t sectors[NUNET_MAX_SECTORS];
  /** The points of obstacles. Unused entries are undefined. */
  nunet_obstacle_point_t points[NUNET_MAX_OBSTACLE_POINTS];
} nunet_obstacles_t;

/**
 * The attitude of the robot's base at one time: x forward, y left, z up.
 * `nunet.v1.AttitudeSample`, 16 bytes.
 */
typedef struct nunet_attitude_sample_t {
  /** When it was measured, nanoseconds of the header's `capture_clock`. */
  int64_t capture_nanos;
  /** Rotation about x, radians. Positive: the right side is lower. */
  float roll_rad;
  /** Rotation about y, radians. Positive: the front is lower. */
  float pitch_rad;
} nunet_attitude_sample_t;

/**
 * The last samples of the attitude of the robot's base.
 * `nunet.v1.AttitudeRecord`, 4160 bytes.
 */
typedef struct nunet_attitude_t {
  /** `NUNET_CONTRACT_VERSION`. */
  uint32_t contract_version;
  /** How many of `samples` are in use. */
  uint32_t sample_count;
  /** Zero; room for later fields. */
  uint8_t reserved[56];
  /** The samples, oldest first. Unused entries are undefined. */
  nunet_attitude_sample_t samples[NUNET_MAX_ATTITUDE_SAMPLES];
} nunet_attitude_t;

#if defined(__cplusplus)
#define NUNET_CHECK(name, holds) static_assert(holds, #name)
#elif defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
#define NUNET_CHECK(name, holds) _Static_assert(holds, #name)
#else
#define NUNET_CHECK(name, holds) typedef char nunet_check_##name[(holds) ? 1 : -1]
#endif
NUNET_CHECK(header_size, sizeof(nunet_header_t) == 1024);
NUNET_CHECK(header_contract_version, offsetof(nunet_header_t, contract_version) == 0);
NUNET_CHECK(header_topic, offsetof(nunet_header_t, topic) == 4);
NUNET_CHECK(header_sequence, offsetof(nunet_header_t, sequence) == 8);
NUNET_CHECK(header_capture_nanos, offsetof(nunet_header_t, capture_nanos) == 16);
NUNET_CHECK(header_capture_unix_nanos, offsetof(nunet_header_t, capture_unix_nanos) == 24);
NUNET_CHECK(header_publish_nanos, offsetof(nunet_header_t, publish_nanos) == 32);
NUNET_CHECK(header_capture_clock, offsetof(nunet_header_t, capture_clock) == 40);
NUNET_CHECK(header_encoding, offsetof(nunet_header_t, encoding) == 44);
NUNET_CHECK(header_width, offsetof(nunet_header_t, width) == 48);
NUNET_CHECK(header_height, offsetof(nunet_header_t, height) == 52);
NUNET_CHECK(header_row_stride_bytes, offsetof(nunet_header_t, row_stride_bytes) == 56);
NUNET_CHECK(header_units, offsetof(nunet_header_t, units) == 60);
NUNET_CHECK(header_payload_bytes, offsetof(nunet_header_t, payload_bytes) == 64);
NUNET_CHECK(header_scale_source, offsetof(nunet_header_t, scale_source) == 72);
NUNET_CHECK(header_quality, offsetof(nunet_header_t, quality) == 76);
NUNET_CHECK(header_fx, offsetof(nunet_header_t, fx) == 80);
NUNET_CHECK(header_fy, offsetof(nunet_header_t, fy) == 88);
NUNET_CHECK(header_cx, offsetof(nunet_header_t, cx) == 96);
NUNET_CHECK(header_cy, offsetof(nunet_header_t, cy) == 104);
NUNET_CHECK(header_distortion, offsetof(nunet_header_t, distortion) == 112);
NUNET_CHECK(header_distortion_model, offsetof(nunet_header_t, distortion_model) == 224);
NUNET_CHECK(header_stage_count, offsetof(nunet_header_t, stage_count) == 228);
NUNET_CHECK(header_model_hash, offsetof(nunet_header_t, model_hash) == 232);
NUNET_CHECK(header_stage_micros, offsetof(nunet_header_t, stage_micros) == 264);
NUNET_CHECK(header_bytes_copied, offsetof(nunet_header_t, bytes_copied) == 328);
NUNET_CHECK(header_invalid_pixels, offsetof(nunet_header_t, invalid_pixels) == 336);
NUNET_CHECK(header_frame_id, offsetof(nunet_header_t, frame_id) == 344);
NUNET_CHECK(header_scale_factor, offsetof(nunet_header_t, scale_factor) == 408);
NUNET_CHECK(header_scale_age_nanos, offsetof(nunet_header_t, scale_age_nanos) == 416);
NUNET_CHECK(header_view_x, offsetof(nunet_header_t, view_x) == 424);
NUNET_CHECK(header_view_y, offsetof(nunet_header_t, view_y) == 428);
NUNET_CHECK(header_view_width, offsetof(nunet_header_t, view_width) == 432);
NUNET_CHECK(header_view_height, offsetof(nunet_header_t, view_height) == 436);
NUNET_CHECK(header_reserved, offsetof(nunet_header_t, reserved) == 440);
NUNET_CHECK(stats_size, sizeof(nunet_stats_t) == 2560);
NUNET_CHECK(stats_contract_version, offsetof(nunet_stats_t, contract_version) == 0);
NUNET_CHECK(stats_stage_count, offsetof(nunet_stats_t, stage_count) == 4);
NUNET_CHECK(stats_captured, offsetof(nunet_stats_t, captured) == 8);
NUNET_CHECK(stats_published, offsetof(nunet_stats_t, published) == 16);
NUNET_CHECK(stats_superseded, offsetof(nunet_stats_t, superseded) == 24);
NUNET_CHECK(stats_failed, offsetof(nunet_stats_t, failed) == 32);
NUNET_CHECK(stats_in_flight, offsetof(nunet_stats_t, in_flight) == 40);
NUNET_CHECK(stats_fps, offsetof(nunet_stats_t, fps) == 48);
NUNET_CHECK(stats_bytes_copied_per_frame, offsetof(nunet_stats_t, bytes_copied_per_frame) == 56);
NUNET_CHECK(stats_allocations_per_frame, offsetof(nunet_stats_t, allocations_per_frame) == 64);
NUNET_CHECK(stats_total_p50_us, offsetof(nunet_stats_t, total_p50_us) == 72);
NUNET_CHECK(stats_total_p90_us, offsetof(nunet_stats_t, total_p90_us) == 80);
NUNET_CHECK(stats_total_p99_us, offsetof(nunet_stats_t, total_p99_us) == 88);
NUNET_CHECK(stats_total_max_us, offsetof(nunet_stats_t, total_max_us) == 96);
NUNET_CHECK(stats_total_mean_us, offsetof(nunet_stats_t, total_mean_us) == 104);
NUNET_CHECK(stats_model_hash, offsetof(nunet_stats_t, model_hash) == 112);
NUNET_CHECK(stats_model_name, offsetof(nunet_stats_t, model_name) == 144);
NUNET_CHECK(stats_provider, offsetof(nunet_stats_t, provider) == 208);
NUNET_CHECK(stats_stage_names, offsetof(nunet_stats_t, stage_names) == 240);
NUNET_CHECK(stats_stage_p50_us, offsetof(nunet_stats_t, stage_p50_us) == 752);
NUNET_CHECK(stats_stage_p90_us, offsetof(nunet_stats_t, stage_p90_us) == 880);
NUNET_CHECK(stats_stage_p99_us, offsetof(nunet_stats_t, stage_p99_us) == 1008);
NUNET_CHECK(stats_stage_max_us, offsetof(nunet_stats_t, stage_max_us) == 1136);
NUNET_CHECK(stats_stage_mean_us, offsetof(nunet_stats_t, stage_mean_us) == 1264);
NUNET_CHECK(stats_has_stability, offsetof(nunet_stats_t, has_stability) == 1392);
NUNET_CHECK(stats_is_unstable, offsetof(nunet_stats_t, is_unstable) == 1396);
NUNET_CHECK(stats_depth_drift, offsetof(nunet_stats_t, depth_drift) == 1400);
NUNET_CHECK(stats_depth_flicker, offsetof(nunet_stats_t, depth_flicker) == 1408);
NUNET_CHECK(stats_reserved, offsetof(nunet_stats_t, reserved) == 1416);
NUNET_CHECK(point_size, sizeof(nunet_point_t) == 16);
NUNET_CHECK(point_x, offsetof(nunet_point_t, x) == 0);
NUNET_CHECK(point_y, offsetof(nunet_point_t, y) == 4);
NUNET_CHECK(point_z, offsetof(nunet_point_t, z) == 8);
NUNET_CHECK(point_b, offsetof(nunet_point_t, b) == 12);
NUNET_CHECK(point_g, offsetof(nunet_point_t, g) == 13);
NUNET_CHECK(point_r, offsetof(nunet_point_t, r) == 14);
NUNET_CHECK(point_label, offsetof(nunet_point_t, label) == 15);
NUNET_CHECK(obstacle_sector_size, sizeof(nunet_obstacle_sector_t) == 32);
NUNET_CHECK(obstacle_sector_range_m, offsetof(nunet_obstacle_sector_t, range_m) == 0);
NUNET_CHECK(obstacle_sector_obstacle_m, offsetof(nunet_obstacle_sector_t, obstacle_m) == 4);
NUNET_CHECK(obstacle_sector_min_height_m, offsetof(nunet_obstacle_sector_t, min_height_m) == 8);
NUNET_CHECK(obstacle_sector_max_height_m, offsetof(nunet_obstacle_sector_t, max_height_m) == 12);
NUNET_CHECK(obstacle_sector_seen_from_m, offsetof(nunet_obstacle_sector_t, seen_from_m) == 16);
NUNET_CHECK(obstacle_sector_age_s, offsetof(nunet_obstacle_sector_t, age_s) == 20);
NUNET_CHECK(obstacle_sector_state, offsetof(nunet_obstacle_sector_t, state) == 24);
NUNET_CHECK(obstacle_sector_label, offsetof(nunet_obstacle_sector_t, label) == 28);
NUNET_CHECK(obstacle_sector_remembered, offsetof(nunet_obstacle_sector_t, remembered) == 29);
NUNET_CHECK(obstacle_sector_reserved, offsetof(nunet_obstacle_sector_t, reserved) == 30);
NUNET_CHECK(obstacle_point_size, sizeof(nunet_obstacle_point_t) == 20);
NUNET_CHECK(obstacle_point_x, offsetof(nunet_obstacle_point_t, x) == 0);
NUNET_CHECK(obstacle_point_y, offsetof(nunet_obstacle_point_t, y) == 4);
NUNET_CHECK(obstacle_point_z, offsetof(nunet_obstacle_point_t, z) == 8);
NUNET_CHECK(obstacle_point_height, offsetof(nunet_obstacle_point_t, height) == 12);
NUNET_CHECK(obstacle_point_label, offsetof(nunet_obstacle_point_t, label) == 16);
NUNET_CHECK(obstacle_point_confidence, offsetof(nunet_obstacle_point_t, confidence) == 17);
NUNET_CHECK(obstacle_point_reserved, offsetof(nunet_obstacle_point_t, reserved) == 18);
NUNET_CHECK(obstacles_size, sizeof(nunet_obstacles_t) == 111680);
NUNET_CHECK(obstacles_contract_version, offsetof(nunet_obstacles_t, contract_version) == 0);
NUNET_CHECK(obstacles_sector_count, offsetof(nunet_obstacles_t, sector_count) == 4);
NUNET_CHECK(obstacles_point_count, offsetof(nunet_obstacles_t, point_count) == 8);
NUNET_CHECK(obstacles_ground_refined, offsetof(nunet_obstacles_t, ground_refined) == 12);
NUNET_CHECK(obstacles_used_labels, offsetof(nunet_obstacles_t, used_labels) == 16);
NUNET_CHECK(obstacles_angle_min_rad, offsetof(nunet_obstacles_t, angle_min_rad) == 20);
NUNET_CHECK(obstacles_angle_step_rad, offsetof(nunet_obstacles_t, angle_step_rad) == 24);
NUNET_CHECK(obstacles_clearance_m, offsetof(nunet_obstacles_t, clearance_m) == 28);
NUNET_CHECK(obstacles_robot_height_m, offsetof(nunet_obstacles_t, robot_height_m) == 32);
NUNET_CHECK(obstacles_max_range_m, offsetof(nunet_obstacles_t, max_range_m) == 36);
NUNET_CHECK(obstacles_floor_fraction, offsetof(nunet_obstacles_t, floor_fraction) == 40);
NUNET_CHECK(obstacles_ground_slope_x, offsetof(nunet_obstacles_t, ground_slope_x) == 44);
NUNET_CHECK(obstacles_ground_slope_y, offsetof(nunet_obstacles_t, ground_slope_y) == 48);
NUNET_CHECK(obstacles_ground_height_m, offsetof(nunet_obstacles_t, ground_height_m) == 52);
NUNET_CHECK(obstacles_used_attitude, offsetof(nunet_obstacles_t, used_attitude) == 56);
NUNET_CHECK(obstacles_reserved, offsetof(nunet_obstacles_t, reserved) == 60);
NUNET_CHECK(obstacles_sectors, offsetof(nunet_obstacles_t, sectors) == 160);
NUNET_CHECK(obstacles_points, offsetof(nunet_obstacles_t, points) == 11680);
NUNET_CHECK(attitude_sample_size, sizeof(nunet_attitude_sample_t) == 16);
NUNET_CHECK(attitude_sample_capture_nanos, offsetof(nunet_attitude_sample_t, capture_nanos) == 0);
NUNET_CHECK(attitude_sample_roll_rad, offsetof(nunet_attitude_sample_t, roll_rad) == 8);
NUNET_CHECK(attitude_sample_pitch_rad, offsetof(nunet_attitude_sample_t, pitch_rad) == 12);
NUNET_CHECK(attitude_size, sizeof(nunet_attitude_t) == 4160);
NUNET_CHECK(attitude_contract_version, offsetof(nunet_attitude_t, contract_version) == 0);
NUNET_CHECK(attitude_sample_count, offsetof(nunet_attitude_t, sample_count) == 4);
NUNET_CHECK(attitude_reserved, offsetof(nunet_attitude_t, reserved) == 8);
NUNET_CHECK(attitude_samples, offsetof(nunet_attitude_t, samples) == 64);
#undef NUNET_CHECK


/**
 * What a function returns. `NUNET_OK` is 0; `nunet_last_error()` describes everything else.
 */
typedef enum {
  /**
   * Success.
   */
  NUNET_OK = 0,
  /**
   * No frame arrived in time. `nunet_reader_is_connected()` returns whether the publisher still runs.
   */
  NUNET_TIMEOUT = 1,
  /**
   * A signal ended the wait.
   */
  NUNET_INTERRUPTED = 2,
  /**
   * No process publishes the camera, or not this topic of it.
   */
  NUNET_NOBODY_PUBLISHES = 3,
  /**
   * The other side uses another version of the contract.
   */
  NUNET_WRONG_CONTRACT_VERSION = 4,
  /**
   * All places for readers of this camera are taken.
   */
  NUNET_TOO_MANY_READERS = 5,
  /**
   * This reader holds as many frames of the topic as it may: release one, or copy it.
   */
  NUNET_TOO_MANY_FRAMES_HELD = 6,
  /**
   * As many loans as allowed are open: send or release one.
   */
  NUNET_TOO_MANY_LOANS = 7,
  /**
   * Another process publishes this camera.
   */
  NUNET_ALREADY_PUBLISHED = 8,
  /**
   * Readers keep services open that were made with other limits.
   */
  NUNET_OTHER_LIMITS = 9,
  /**
   * Shared memory is missing or too small.
   */
  NUNET_SHARED_MEMORY = 10,
  /**
   * The reader was not opened with this topic.
   */
  NUNET_NO_SUCH_TOPIC = 11,
  /**
   * The payload is of another kind than asked for.
   */
  NUNET_WRONG_ENCODING = 12,
  /**
   * The sender's header contradicts its payload.
   */
  NUNET_BAD_MESSAGE = 13,
  /**
   * An argument is NULL, not a UTF-8 string, or out of range.
   */
  NUNET_BAD_ARGUMENT = 14,
  /**
   * The handle was closed, released or sent before, or is not a handle.
   */
  NUNET_CLOSED = 15,
  /**
   * The handle belongs to the process that this one was forked from.
   */
  NUNET_FORKED = 16,
  /**
   * The system or iceoryx2 failed; see the text.
   */
  NUNET_SYSTEM = 17,
  /**
   * A bug in this library. Please report the text.
   */
  NUNET_PANIC = 18,
} nunet_status_t;

/**
 * The publisher of the attitude for a camera. Calls with one publisher run one after the other, from any
 * threads.
 */
typedef struct nunet_attitude_publisher_t nunet_attitude_publisher_t;

/**
 * One message in shared memory, read-only. Its memory does not change until it is released, also after its
 * reader is closed and its publisher has ended. Any thread may read and release it.
 */
typedef struct nunet_frame_t nunet_frame_t;

/**
 * The memory of an image that is not sent yet. Any thread may fill and send it.
 */
typedef struct nunet_loan_t nunet_loan_t;

/**
 * The publisher of a camera's topic `rgb`. Calls with one publisher run one after the other, from any
 * threads.
 */
typedef struct nunet_publisher_t nunet_publisher_t;

/**
 * A reader of some of a camera's topics. Calls with one reader run one after the other, from any threads.
 */
typedef struct nunet_reader_t nunet_reader_t;

/**
 * Frames with one sequence number and one capture time.
 */
typedef struct {
  /**
   * The frame of each topic, indexed by `nunet_topic_t`; NULL where there is none. No set has `stats` or
   * `attitude`.
   */
  nunet_frame_t *frames[8];
} nunet_set_t;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The error of the last failed call of this thread, usually with a last line `hint: ...`. UTF-8; empty if no
 * call has failed yet. Successful calls do not change it.
 *
 * The string belongs to the library and is valid until the next call of this thread fails.
 */
const char *nunet_last_error(void);

/**
 * The name of a status, such as `too many readers`; `unknown status` for any other number. A static string.
 */
const char *nunet_status_name(int32_t status);

/**
 * The library's version, such as `0.1.0`. A static string. `NUNET_VERSION` is that of the header.
 */
const char *nunet_version(void);

/**
 * The version of the shared-memory contract that the library implements. `NUNET_CONTRACT_VERSION` is that of
 * the header.
 */
uint32_t nunet_contract_version(void);

/**
 * Now, in nanoseconds of `CLOCK_MONOTONIC`: the clock of `publish_nanos`, and of `capture_nanos` where
 * `capture_clock` says so.
 */
int64_t nunet_monotonic_nanos(void);

/**
 * Opens topics of a camera. Waits for its publisher until the timeout.
 *
 * `camera`: the name given to `nunetd --camera`. `topic_bits`: `NUNET_BIT_DEPTH | NUNET_BIT_LABELS | ...`.
 * `timeout_ms`: milliseconds, or `NUNET_FOREVER`. A signal does not end this wait: a program that must react
 * to one calls this repeatedly with a short timeout. `*reader` is the caller's, to be closed with
 * `nunet_reader_close()`; NULL after a failure.
 *
 * Fails with `NUNET_NOBODY_PUBLISHES` after the timeout, `NUNET_TOO_MANY_READERS`,
 * `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_reader_open(const char *camera,
                                 uint32_t topic_bits,
                                 uint32_t timeout_ms,
                                 nunet_reader_t **reader);

/**
 * Sleeps until there may be a new frame, or the time is over. Only a hint, for programs with their own loop:
 * look for frames whatever it returns. `nunet_reader_next()` waits by itself.
 *
 * `woken` (may be NULL): whether a publisher sent something, started or ended. A signal ends the sleep
 * early.
 *
 * Fails with `NUNET_CLOSED`, also when another thread closes the reader meanwhile; `NUNET_SYSTEM`,
 * `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_reader_wait(const nunet_reader_t *reader, uint32_t timeout_ms, bool *woken);

/**
 * The newest frame of a topic that was not returned yet. Sleeps until there is one. Older frames are
 * skipped.
 *
 * `topic`: a `nunet_topic_t`. `timeout_ms`: milliseconds; 0 does not wait. `*frame` is the caller's, to be
 * released with `nunet_frame_release()`; NULL after a failure. A reader may hold a few frames of a topic at
 * a time, by default 2.
 *
 * Fails with `NUNET_TIMEOUT`; `NUNET_INTERRUPTED` when a signal handler ran while it waited;
 * `NUNET_TOO_MANY_FRAMES_HELD` when there is a frame but the caller holds as many as it may;
 * `NUNET_NO_SUCH_TOPIC`, `NUNET_BAD_MESSAGE`, `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_reader_next(const nunet_reader_t *reader,
                                 uint32_t topic,
                                 uint32_t timeout_ms,
                                 nunet_frame_t **frame);

/**
 * The newest frames of all the reader's topics that belong together: all with one `sequence` and one
 * `capture_nanos`. Waits for them as `nunet_reader_next()` does, which alone returns `stats` and `attitude`.
 *
 * `set->frames[NUNET_TOPIC_...]`: a frame for each such topic that was opened, NULL for the others, all NULL
 * after a failure. They are the caller's: release each with `nunet_frame_release()`, or all with
 * `nunet_set_release()`.
 *
 * Fails as `nunet_reader_next()` does.
 */
nunet_status_t nunet_reader_next_set(const nunet_reader_t *reader, uint32_t timeout_ms, nunet_set_t *set);

/**
 * The process that publishes a topic. It reads the file system, so call it when no frames arrive, not for
 * every frame.
 *
 * `pid` (may be NULL): 0 when there is none. `alive` (may be NULL): false when there is none, or it was
 * killed.
 *
 * Fails with `NUNET_NO_SUCH_TOPIC`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_reader_publisher(const nunet_reader_t *reader,
                                      uint32_t topic,
                                      uint32_t *pid,
                                      bool *alive);

/**
 * Whether a living process publishes each of the reader's topics; as costly as `nunet_reader_publisher()`. A
 * reader that is not connected need not be opened again: it receives the frames of the next publisher. False
 * for a reader that is closed or NULL.
 */
bool nunet_reader_is_connected(const nunet_reader_t *reader);

/**
 * Closes a reader. Its frames stay valid until they are released. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when it was closed before.
 */
nunet_status_t nunet_reader_close(nunet_reader_t *reader);

/**
 * The header of a frame.
 *
 * `*header` is valid until the frame is released; NULL after a failure.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`, as the functions below do too.
 */
nunet_status_t nunet_frame_header(const nunet_frame_t *frame, const nunet_header_t **header);

/**
 * A frame's payload, of any encoding, aligned to 64 bytes.
 *
 * `*bytes` is valid until the frame is released; NULL after a failure. `byte_count` may be NULL.
 */
nunet_status_t nunet_frame_bytes(const nunet_frame_t *frame, const void **bytes, size_t *byte_count);

/**
 * The time since capture, in nanoseconds: by the monotonic clock where the camera uses it, otherwise by the
 * time of day.
 *
 * `*age_nanos` is `INT64_MIN` where the sender knows neither.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_frame_age(const nunet_frame_t *frame, int64_t *age_nanos);

/**
 * A depth map: `height` rows from the top of `width` floats, in the header's units (usually meters), NaN
 * where there is no measurement.
 *
 * `*depth` is valid until the frame is released; NULL after a failure. `width` and `height` may be NULL.
 *
 * Fails with `NUNET_WRONG_ENCODING` when it is something else, `NUNET_BAD_MESSAGE` when its size is not that
 * of its header.
 */
nunet_status_t nunet_frame_depth(const nunet_frame_t *frame,
                                 const float **depth,
                                 uint32_t *width,
                                 uint32_t *height);

/**
 * The class of each pixel: `height` rows from the top of `width` bytes. `nunetd inspect MODEL` names the
 * classes.
 *
 * Pointers and failures as in `nunet_frame_depth()`.
 */
nunet_status_t nunet_frame_labels(const nunet_frame_t *frame,
                                  const uint8_t **labels,
                                  uint32_t *width,
                                  uint32_t *height);

/**
 * The confidence of each pixel's depth: `height` rows from the top of `width` bytes, 255 = certain, 0 where
 * there is no measurement.
 *
 * Pointers and failures as in `nunet_frame_depth()`.
 */
nunet_status_t nunet_frame_confidence(const nunet_frame_t *frame,
                                      const uint8_t **confidence,
                                      uint32_t *width,
                                      uint32_t *height);

/**
 * A cloud: `height` rows from the top of `width` points in the camera's optical frame (x right, y down, z
 * forward), in the header's units; NaN where there is no measurement.
 *
 * Pointers and failures as in `nunet_frame_depth()`.
 */
nunet_status_t nunet_frame_points(const nunet_frame_t *frame,
                                  const nunet_point_t **points,
                                  uint32_t *width,
                                  uint32_t *height);

/**
 * The daemon's counts and latencies, from a frame of the topic `stats`.
 *
 * `*stats` is valid until the frame is released; NULL after a failure.
 *
 * Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
 */
nunet_status_t nunet_frame_stats(const nunet_frame_t *frame, const nunet_stats_t **stats);

/**
 * The obstacles around the robot, from a frame of the topic `obstacles`.
 *
 * `*obstacles` is valid until the frame is released; NULL after a failure. Only the first `sector_count`
 * sectors and `point_count` points mean something.
 *
 * Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
 */
nunet_status_t nunet_frame_obstacles(const nunet_frame_t *frame, const nunet_obstacles_t **obstacles);

/**
 * The attitude of the robot's base, from a frame of the topic `attitude`.
 *
 * `*attitude` is valid until the frame is released; NULL after a failure. Only the first `sample_count`
 * samples mean something.
 *
 * Fails with `NUNET_WRONG_ENCODING`, `NUNET_BAD_MESSAGE`.
 */
nunet_status_t nunet_frame_attitude(const nunet_frame_t *frame, const nunet_attitude_t **attitude);

/**
 * Releases a frame. Pointers into it are no longer valid. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when it was released before.
 */
nunet_status_t nunet_frame_release(nunet_frame_t *frame);

/**
 * Releases all frames of a set and sets its pointers to NULL. To keep a frame longer, copy its pointer and
 * set the one in the set to NULL first. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when one of them was released before; the others are released anyway.
 */
nunet_status_t nunet_set_release(nunet_set_t *set);

/**
 * Becomes the publisher of a camera, whose images `nunetd --source shm:CAMERA` reads; reserves the shared
 * memory for them.
 *
 * `encoding`: a `nunet_encoding_t` of images (rgb8, bgr8, mono8, yuyv, nv12). `width`, `height`: pixels.
 * `max_readers`: how many may read the camera at a time; 0 for 4, and at most 64. `*publisher` is the
 * caller's, to be closed with `nunet_publisher_close()`; NULL after a failure.
 *
 * Fails with `NUNET_ALREADY_PUBLISHED` when another process publishes this camera, `NUNET_SHARED_MEMORY`
 * when its memory does not fit, `NUNET_OTHER_LIMITS`, `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`,
 * `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_open(const char *camera,
                                    uint32_t encoding,
                                    uint32_t width,
                                    uint32_t height,
                                    uint32_t max_readers,
                                    nunet_publisher_t **publisher);

/**
 * Sets the camera's intrinsics, which every later image carries. They are needed for depth in meters;
 * without this call the camera is unknown.
 *
 * `fx`, `fy`: focal lengths in pixels at the publisher's size. `cx`, `cy`: principal point in pixels; the
 * center of the first pixel is 0. `distortion_model`: a `nunet_distortion_model_t`; `coefficients`:
 * `coefficient_count` of its coefficients (at most 14; `NUNET_DISTORTION_MODEL_NONE` has none), copied.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_set_camera(const nunet_publisher_t *publisher,
                                          double fx,
                                          double fy,
                                          double cx,
                                          double cy,
                                          uint32_t distortion_model,
                                          const double *coefficients,
                                          size_t coefficient_count);

/**
 * Sets the name of the camera's coordinate frame, which every later image carries: UTF-8, at most 64 bytes,
 * copied.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_set_frame_id(const nunet_publisher_t *publisher, const char *frame_id);

/**
 * Borrows the memory of the next image, to be filled in place: readers see the same memory, and nothing is
 * copied. One loan may be open at a time.
 *
 * `*loan` is the caller's, to be sent with `nunet_loan_send()` or given back with `nunet_loan_release()`;
 * NULL after a failure.
 *
 * Fails with `NUNET_TOO_MANY_LOANS`, `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_loan(const nunet_publisher_t *publisher, nunet_loan_t **loan);

/**
 * Publishes a copy of an image that is in other memory already; `nunet_publisher_loan()` avoids the copy.
 *
 * `bytes`: `byte_count` of them, exactly as many as an image of the publisher's size and encoding has
 * without padding between rows. `clock` and `capture_nanos` as in `nunet_loan_send()`.
 *
 * Fails with `NUNET_TOO_MANY_LOANS` while a loan is open, `NUNET_SYSTEM`, `NUNET_CLOSED`,
 * `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_publish(const nunet_publisher_t *publisher,
                                       const void *bytes,
                                       size_t byte_count,
                                       uint32_t clock,
                                       int64_t capture_nanos);

/**
 * Whether the camera has readers: an image without readers need not be computed. A killed reader counts
 * until some process cleans up after it. False for a publisher that is closed or NULL.
 */
bool nunet_publisher_has_readers(const nunet_publisher_t *publisher);

/**
 * Sends the newest image to readers that opened since. Sending an image does the same: this is for sources
 * that are paused; call it a few times per second.
 *
 * Fails with `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_publisher_refresh(const nunet_publisher_t *publisher);

/**
 * Closes a publisher, so that the camera may have another one. An open loan can only be released afterwards,
 * and keeps the camera until it is. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when it was closed before.
 */
nunet_status_t nunet_publisher_close(nunet_publisher_t *publisher);

/**
 * The header of an image that is not sent yet. Size, encoding, sequence number, and what was set for the
 * publisher are filled in; the rest is zero. It may be changed; `topic`, `payload_bytes`, `contract_version`
 * and the times are written again by `nunet_loan_send()`. The numbers of later images continue from
 * `sequence`.
 *
 * `*header` is valid until the loan is sent or released; NULL after a failure.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_loan_header(const nunet_loan_t *loan, nunet_header_t **header);

/**
 * The pixels of an image that is not sent yet, aligned to 64 bytes: rows from the top without padding. They
 * still contain an earlier image.
 *
 * `*bytes` is valid until the loan is sent or released; NULL after a failure. `byte_count` may be NULL.
 *
 * Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_loan_bytes(const nunet_loan_t *loan, void **bytes, size_t *byte_count);

/**
 * Sends an image and wakes its readers. The loan is closed, also when this fails.
 *
 * `clock`: the `nunet_clock_t` that `capture_nanos` was read from; `NUNET_CLOCK_MONOTONIC` for V4L2's times
 * and `nunet_monotonic_nanos()`. `capture_nanos`: the capture time, 0 or more; a reader of several topics
 * joins frames with one `sequence` and one `capture_nanos`. `capture_unix_nanos` is computed where it was
 * left 0; with `NUNET_CLOCK_MEDIA` it is the time of this call.
 *
 * Fails with `NUNET_CLOSED`, also when the publisher was closed before; `NUNET_SYSTEM`,
 * `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_loan_send(nunet_loan_t *loan, uint32_t clock, int64_t capture_nanos);

/**
 * Returns a loan without sending it. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when it was sent or released before.
 */
nunet_status_t nunet_loan_release(nunet_loan_t *loan);

/**
 * Becomes the publisher of the attitude of the robot's base for a camera, which `nunetd --attitude shm`
 * reads.
 *
 * `clock`: a `nunet_clock_t`, that of the samples' times. `*attitude` is the caller's, to be closed with
 * `nunet_attitude_close()`; NULL after a failure.
 *
 * Fails with `NUNET_ALREADY_PUBLISHED` when another process publishes it, `NUNET_SHARED_MEMORY`,
 * `NUNET_OTHER_LIMITS`, `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`, `NUNET_BAD_ARGUMENT`.
 */
nunet_status_t nunet_attitude_open(const char *camera, uint32_t clock, nunet_attitude_publisher_t **attitude);

/**
 * Publishes a sample. Call it for each measurement of the sensor, about 50 to 200 times per second.
 *
 * `capture_nanos`: when it was measured, nanoseconds of the publisher's clock (`nunet_monotonic_nanos()`).
 * `roll_rad`, `pitch_rad`: rotation of the base about x (forward) and y (left), radians; a positive roll
 * lowers the right side, a positive pitch the front.
 *
 * Fails with `NUNET_BAD_ARGUMENT` for an angle that is not a number or is beyond a turn and for a negative
 * time, `NUNET_SYSTEM`, `NUNET_CLOSED`.
 */
nunet_status_t nunet_attitude_publish(const nunet_attitude_publisher_t *attitude,
                                      int64_t capture_nanos,
                                      float roll_rad,
                                      float pitch_rad);

/**
 * Closes a publisher of the attitude. NULL is allowed.
 *
 * Fails with `NUNET_CLOSED` when it was closed before.
 */
nunet_status_t nunet_attitude_close(nunet_attitude_publisher_t *attitude);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* NUNET_H */
