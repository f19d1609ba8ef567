/* survive CAMERA: keeps a frame while nunetd is killed and started again. Prints each step on stdout and then waits for
 * a line on stdin. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "nunet.h"

static int fail(const char *what) {
  printf("failed: %s: %s\n", what, nunet_last_error());
  return EXIT_FAILURE;
}

static void step(const char *text) {
  char line[16];
  printf("%s\n", text);
  fflush(stdout);
  if (!fgets(line, sizeof line, stdin)) exit(EXIT_FAILURE);
}

int main(int argc, char **argv) {
  nunet_reader_t *reader;
  nunet_frame_t *kept, *frame;
  const void *bytes;
  void *before;
  size_t count;
  uint32_t pid;
  bool alive;
  nunet_status_t status;
  int attempt;
  if (argc < 2 || nunet_reader_open(argv[1], NUNET_BIT_DEPTH, 30000, &reader)) return fail("open");
  if (nunet_reader_next(reader, NUNET_TOPIC_DEPTH, 30000, &kept)) return fail("next");
  if (nunet_frame_bytes(kept, &bytes, &count) || !(before = malloc(count))) return fail("bytes");
  memcpy(before, bytes, count);
  if (nunet_reader_publisher(reader, NUNET_TOPIC_DEPTH, &pid, &alive) || !alive) return fail("publisher");
  printf("%lu\n", (unsigned long)pid);
  step("reading");

  /* Frames that were sent before the end may still arrive. After them, reads time out. */
  for (attempt = 0; attempt < 100; attempt++) {
    status = nunet_reader_next(reader, NUNET_TOPIC_DEPTH, 300, &frame);
    if (status) break;
    nunet_frame_release(frame);
  }
  if (status != NUNET_TIMEOUT || frame) return fail("after the end");
  if (!strstr(nunet_last_error(), "no process publishes the camera")) return fail("text");
  if (nunet_reader_is_connected(reader)) return fail("is_connected");
  if (nunet_reader_publisher(reader, NUNET_TOPIC_DEPTH, &pid, &alive) || alive) return fail("publisher after the end");
  if (memcmp(before, bytes, count) != 0) return fail("the kept frame changed");
  step("alone");

  /* The same reader receives the frames of the next publisher. */
  status = nunet_reader_next(reader, NUNET_TOPIC_DEPTH, 60000, &frame);
  if (status || !nunet_reader_is_connected(reader)) return fail("after the restart");
  if (memcmp(before, bytes, count) != 0) return fail("the kept frame changed after the restart");
  nunet_frame_release(frame);
  nunet_reader_close(reader);
  if (memcmp(before, bytes, count) != 0) return fail("the kept frame changed after the reader");
  free(before);
  if (nunet_frame_release(kept)) return fail("release");
  printf("done\n");
  return EXIT_SUCCESS;
}
