/* camera NAME ENCODING WIDTH HEIGHT FRAMES: publishes gray images in one encoding, 50 per second. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "nunet.h"

int main(int argc, char **argv) {
  nunet_publisher_t *publisher;
  nunet_loan_t *loan;
  struct timespec pause = {0, 20 * 1000000L};
  size_t count;
  void *bytes;
  long left;
  if (argc < 6) return 2;
  if (nunet_publisher_open(argv[1], (uint32_t)atol(argv[2]), (uint32_t)atol(argv[3]), (uint32_t)atol(argv[4]), 0,
                           &publisher))
    goto failed;
  if (nunet_publisher_set_camera(publisher, 30, 30, 16, 12, NUNET_DISTORTION_MODEL_NONE, NULL, 0)) goto failed;
  for (left = atol(argv[5]); left > 0; left--) {
    if (nunet_publisher_loan(publisher, &loan) || nunet_loan_bytes(loan, &bytes, &count)) goto failed;
    memset(bytes, 128, count);
    if (nunet_loan_send(loan, NUNET_CLOCK_MONOTONIC, nunet_monotonic_nanos())) goto failed;
    nanosleep(&pause, NULL);
  }
  return nunet_publisher_close(publisher);
failed:
  fprintf(stderr, "%s\n", nunet_last_error());
  return EXIT_FAILURE;
}
