/* Reads depth from a running nunetd: subscribe CAMERA [FRAMES]. How to compile it: docs/book/shared-memory.md.
 *
 * Prints each frame's sequence number, the time since its capture, and the depth at the center of the image. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "nunet.h"

static int fail(void) {
  fprintf(stderr, "error: %s\n", nunet_last_error());
  return EXIT_FAILURE;
}

static int print(const nunet_frame_t *frame) {
  const nunet_header_t *header;
  const float *depth; /* a view of shared memory */
  uint32_t width, height;
  int64_t age_nanos; /* INT64_MIN if the capture time is unknown */
  double age_ms;
  if (nunet_frame_header(frame, &header) || nunet_frame_depth(frame, &depth, &width, &height)) return 0;
  if (nunet_frame_age(frame, &age_nanos)) return 0;
  age_ms = (double)age_nanos / 1e6;
  printf("frame %" PRIu64 ": captured %.2f ms ago, center %.3f\n", header->sequence, age_ms,
         (double)depth[height / 2 * width + width / 2]);
  return 1;
}

int main(int argc, char **argv) {
  const char *camera = argc > 1 ? argv[1] : "demo";
  long frames = argc > 2 ? atol(argv[2]) : 100;
  nunet_reader_t *reader;
  if (nunet_reader_open(camera, NUNET_BIT_DEPTH, 10000, &reader)) return fail();
  while (frames > 0) {
    nunet_frame_t *frame;
    nunet_status_t status = nunet_reader_next(reader, NUNET_TOPIC_DEPTH, 1000, &frame);
    if (status == NUNET_TIMEOUT) {
      fprintf(stderr, "%s\n", nunet_last_error()); /* frames of the next publisher will arrive here */
      continue;
    }
    if (status || !print(frame)) return fail();
    nunet_frame_release(frame);
    frames--;
  }
  nunet_reader_close(reader);
  return EXIT_SUCCESS;
}
