/* dump CAMERA FRAMES: prints hashes of complete sets of depth, labels and cloud, to compare them with those of another
 * reader. The last line has fields of the topic `stats`. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "nunet.h"

static uint64_t hash(const void *bytes, size_t count) { /* FNV-1a */
  const unsigned char *byte = bytes;
  uint64_t sum = UINT64_C(14695981039346656037);
  while (count--) sum = (sum ^ *byte++) * UINT64_C(1099511628211);
  return sum;
}

static int fail(const char *what) {
  fprintf(stderr, "%s: %s\n", what, nunet_last_error());
  return EXIT_FAILURE;
}

static int print(const nunet_frame_t *frame) {
  const nunet_header_t *header;
  const void *bytes;
  size_t count;
  if (nunet_frame_header(frame, &header) || nunet_frame_bytes(frame, &bytes, &count)) return 0;
  printf("%" PRIu64 " %" PRIu32 " %016" PRIx64 " %016" PRIx64 "\n", header->sequence, header->topic,
         hash(header, sizeof *header), hash(bytes, count));
  return 1;
}

/* The typed views are the same bytes, as large as the header says. */
static int agree(const nunet_set_t *set) {
  const void *bytes;
  const float *depth;
  const uint8_t *labels;
  const nunet_point_t *points;
  uint32_t width, height;
  size_t count, pixel, pixels;
  nunet_frame_t *const *frames = set->frames;
  if (nunet_frame_depth(frames[NUNET_TOPIC_DEPTH], &depth, &width, &height)) return 0;
  if (nunet_frame_bytes(frames[NUNET_TOPIC_DEPTH], &bytes, &count)) return 0;
  pixels = (size_t)width * height;
  if (bytes != (const void *)depth || count != pixels * 4) return 0;
  if (nunet_frame_labels(frames[NUNET_TOPIC_LABELS], &labels, &width, &height)) return 0;
  if (nunet_frame_bytes(frames[NUNET_TOPIC_LABELS], &bytes, &count)) return 0;
  if (bytes != (const void *)labels || count != pixels || (size_t)width * height != pixels) return 0;
  if (nunet_frame_points(frames[NUNET_TOPIC_CLOUD], &points, NULL, NULL)) return 0;
  for (pixel = 0; pixel < pixels; pixel++) {
    if (memcmp(&points[pixel].z, &depth[pixel], 4) != 0 && points[pixel].z == points[pixel].z) return 0;
  }
  return 1;
}

static int print_stats(const nunet_reader_t *reader) {
  nunet_frame_t *frame;
  const nunet_stats_t *stats;
  if (nunet_reader_next(reader, NUNET_TOPIC_STATS, 10000, &frame) || nunet_frame_stats(frame, &stats)) return 0;
  printf("stats %.64s %.32s %.32s %d\n", stats->model_name, stats->provider, stats->stage_names[0],
         stats->captured == stats->published + stats->superseded + stats->failed + stats->in_flight);
  return nunet_frame_release(frame) == NUNET_OK;
}

int main(int argc, char **argv) {
  long left = argc > 2 ? atol(argv[2]) : 1;
  uint32_t bits = NUNET_BIT_DEPTH | NUNET_BIT_LABELS | NUNET_BIT_CLOUD | NUNET_BIT_STATS;
  nunet_reader_t *reader;
  nunet_set_t set;
  if (argc < 2 || nunet_reader_open(argv[1], bits, 30000, &reader)) return fail("open");
  for (; left > 0; left--) {
    size_t topic;
    if (nunet_reader_next_set(reader, 30000, &set)) return fail("next_set");
    if (!agree(&set)) return fail("agree");
    for (topic = 0; topic < sizeof set.frames / sizeof *set.frames; topic++) {
      if (set.frames[topic] && !print(set.frames[topic])) return fail("print");
    }
    if (nunet_set_release(&set)) return fail("release");
  }
  if (!print_stats(reader)) return fail("stats");
  return nunet_reader_close(reader);
}
