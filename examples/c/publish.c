/* A camera driver: publish CAMERA [FRAMES], for nunetd --source shm:CAMERA. How to compile it: docs/book/shared-memory.md.
 *
 * Writes a moving pattern directly into shared memory, 30 times a second. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "nunet.h"

enum { WIDTH = 640, HEIGHT = 480 };

static int fail(void) {
  fprintf(stderr, "error: %s\n", nunet_last_error());
  return EXIT_FAILURE;
}

static void draw(unsigned char *rgb, long frame) {
  size_t x, y;
  for (y = 0; y < HEIGHT; y++) {
    for (x = 0; x < WIDTH; x++, rgb += 3) {
      rgb[0] = (unsigned char)(x + (size_t)frame);
      rgb[1] = (unsigned char)y;
      rgb[2] = (unsigned char)(x ^ y);
    }
  }
}

int main(int argc, char **argv) {
  const char *camera = argc > 1 ? argv[1] : "front";
  long frame, frames = argc > 2 ? atol(argv[2]) : 100;
  nunet_publisher_t *publisher;
  if (nunet_publisher_open(camera, NUNET_ENCODING_RGB8, WIDTH, HEIGHT, 0, &publisher)) return fail();
  if (nunet_publisher_set_camera(publisher, 520, 520, 319.5, 239.5, NUNET_DISTORTION_MODEL_NONE, NULL, 0))
    return fail();
  for (frame = 0; frame < frames; frame++) {
    struct timespec pause = {0, 1000000000L / 30};
    nunet_loan_t *loan;
    void *rgb;
    if (nunet_publisher_loan(publisher, &loan) || nunet_loan_bytes(loan, &rgb, NULL)) return fail();
    draw(rgb, frame);
    if (nunet_loan_send(loan, NUNET_CLOCK_MONOTONIC, nunet_monotonic_nanos())) return fail();
    nanosleep(&pause, NULL);
  }
  nunet_publisher_close(publisher);
  return EXIT_SUCCESS;
}
