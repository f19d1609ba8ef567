/* misuse CAMERA OWN: wrong calls of all functions. Each must return an error and must not crash. A running nunetd
 * publishes CAMERA; no process publishes OWN. */
#define _POSIX_C_SOURCE 200809L
#define _XOPEN_SOURCE 700
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "nunet.h"

static int failures = 0;

#define EXPECT(expected, call) expect(__LINE__, #call, expected, call)
#define HOLDS(condition) holds(__LINE__, #condition, (condition) ? 1 : 0)
#define DEPTH NUNET_TOPIC_DEPTH
#define RGB NUNET_TOPIC_RGB

static void expect(int line, const char *call, nunet_status_t expected, nunet_status_t found) {
  /* Every failure has a hint. A timeout and an interruption are no failures. */
  int has_text = found == NUNET_TIMEOUT || found == NUNET_INTERRUPTED ? *nunet_last_error() != 0
                                                                       : strstr(nunet_last_error(), "\nhint: ") != NULL;
  if (expected == found && (found == NUNET_OK || has_text)) return;
  failures++;
  printf("line %d: %s: expected `%s` with a hint, got `%s` (%s)\n", line, call, nunet_status_name((int)expected),
         nunet_status_name((int)found), found ? nunet_last_error() : "");
}

static void holds(int line, const char *condition, int found) {
  if (found) return;
  failures++;
  printf("line %d: %s does not hold\n", line, condition);
}

static void nulls(void) {
  nunet_reader_t *reader = NULL;
  nunet_frame_t *frame = NULL;
  nunet_set_t set;
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open(NULL, NUNET_BIT_DEPTH, 0, &reader));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("front", NUNET_BIT_DEPTH, 0, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_wait(NULL, 0, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_next(NULL, DEPTH, 0, &frame));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_next_set(NULL, 0, &set));
  HOLDS(set.frames[0] == NULL && set.frames[5] == NULL);
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_next_set(NULL, 0, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_publisher(NULL, DEPTH, NULL, NULL));
  HOLDS(!nunet_reader_is_connected(NULL));
  EXPECT(NUNET_OK, nunet_reader_close(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_header(NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_bytes(NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_depth(NULL, NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_labels(NULL, NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_confidence(NULL, NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_points(NULL, NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_stats(NULL, NULL));
  EXPECT(NUNET_OK, nunet_frame_release(NULL));
  EXPECT(NUNET_OK, nunet_set_release(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_open("front", NUNET_ENCODING_RGB8, 4, 4, 0, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(NULL, 1, 1, 0, 0, 0, NULL, 0));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_frame_id(NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_loan(NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_publish(NULL, NULL, 4, 0, 0));
  HOLDS(!nunet_publisher_has_readers(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_refresh(NULL));
  EXPECT(NUNET_OK, nunet_publisher_close(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_loan_header(NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_loan_bytes(NULL, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_loan_send(NULL, 0, 0));
  EXPECT(NUNET_OK, nunet_loan_release(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_attitude_open("front", NUNET_CLOCK_MONOTONIC, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_attitude_publish(NULL, 0, 0, 0));
  EXPECT(NUNET_OK, nunet_attitude_close(NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_frame_attitude(NULL, NULL));
}

static void names(void) {
  nunet_reader_t *reader = (nunet_reader_t *)&failures; /* must become NULL */
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("caf\xe9", NUNET_BIT_DEPTH, 0, &reader));
  HOLDS(reader == NULL);
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("left/arm", NUNET_BIT_DEPTH, 0, &reader));
  HOLDS(strstr(nunet_last_error(), "hint: use a name like `left_arm`") != NULL);
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("", NUNET_BIT_DEPTH, 0, &reader));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("front", 0, 0, &reader));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_open("front", NUNET_BIT_ATTITUDE << 1, 0, &reader));
  EXPECT(NUNET_NOBODY_PUBLISHES, nunet_reader_open("nobody-has-this-name", NUNET_BIT_DEPTH, 50, &reader));
  HOLDS(strstr(nunet_last_error(), "\nhint: ") != NULL);
}

static void *release(void *frame) {
  EXPECT(NUNET_OK, nunet_frame_release(frame));
  return NULL;
}

static void frames(const char *camera) {
  nunet_reader_t *reader, *closed;
  nunet_frame_t *kept, *other, *frame;
  const nunet_header_t *header;
  const uint8_t *labels;
  const float *depth;
  uint32_t width, height;
  uint64_t sequence;
  pthread_t thread;
  nunet_status_t status;
  EXPECT(NUNET_OK, nunet_reader_open(camera, NUNET_BIT_DEPTH, 30000, &reader));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_next(reader, 99, 0, &frame));
  EXPECT(NUNET_NO_SUCH_TOPIC, nunet_reader_next(reader, NUNET_TOPIC_LABELS, 0, &frame));
  EXPECT(NUNET_NO_SUCH_TOPIC, nunet_reader_publisher(reader, NUNET_TOPIC_CLOUD, NULL, NULL));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_reader_next(reader, DEPTH, 0, NULL));

  EXPECT(NUNET_OK, nunet_reader_next(reader, DEPTH, 30000, &kept));
  EXPECT(NUNET_OK, nunet_reader_next(reader, DEPTH, 30000, &other));
  do {
    status = nunet_reader_next(reader, DEPTH, 1000, &frame); /* until there is a third one */
  } while (status == NUNET_TIMEOUT);
  EXPECT(NUNET_TOO_MANY_FRAMES_HELD, status);
  HOLDS(frame == NULL && strstr(nunet_last_error(), "\nhint: ") != NULL);
  EXPECT(NUNET_OK, nunet_frame_release(other));
  EXPECT(NUNET_CLOSED, nunet_frame_release(other));
  EXPECT(NUNET_CLOSED, nunet_frame_depth(other, &depth, &width, &height));
  HOLDS(depth == NULL);
  EXPECT(NUNET_OK, nunet_reader_next(reader, DEPTH, 30000, &other));
  EXPECT(NUNET_OK, nunet_frame_release(other));

  EXPECT(NUNET_WRONG_ENCODING, nunet_frame_labels(kept, &labels, NULL, NULL));
  HOLDS(labels == NULL);
  EXPECT(NUNET_WRONG_ENCODING, nunet_frame_confidence(kept, &labels, NULL, NULL));
  HOLDS(labels == NULL);
  EXPECT(NUNET_CLOSED, nunet_frame_header((nunet_frame_t *)reader, &header));
  EXPECT(NUNET_CLOSED, nunet_frame_header((nunet_frame_t *)(size_t)0x1234, &header));
  EXPECT(NUNET_OK, nunet_frame_header(kept, &header));
  sequence = header->sequence;

  closed = reader;
  EXPECT(NUNET_OK, nunet_reader_close(reader));
  EXPECT(NUNET_CLOSED, nunet_reader_close(closed));
  EXPECT(NUNET_CLOSED, nunet_reader_next(closed, DEPTH, NUNET_FOREVER, &frame));
  EXPECT(NUNET_CLOSED, nunet_reader_wait(closed, NUNET_FOREVER, NULL));
  HOLDS(!nunet_reader_is_connected(closed));
  EXPECT(NUNET_OK, nunet_frame_depth(kept, &depth, &width, &height));
  HOLDS(header->sequence == sequence && width == header->width && height == header->height);
  HOLDS(depth[0] == depth[0] || header->invalid_pixels > 0);
  HOLDS(pthread_create(&thread, NULL, release, kept) == 0 && pthread_join(thread, NULL) == 0);
  EXPECT(NUNET_CLOSED, nunet_frame_release(kept));
}

static void publisher_arguments(nunet_publisher_t *publisher) {
  double lens[15] = {0};
  char name[66];
  memset(name, 'x', 65);
  name[65] = 0;
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(publisher, 0, 1, 0, 0, 0, NULL, 0));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(publisher, 1, 1, 0, 0, 7, NULL, 0));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(publisher, 1, 1, 0, 0, 1, lens, 15));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(publisher, 1, 1, 0, 0, 1, NULL, 5));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_camera(publisher, 1, 1, 0, 0, 0, lens, 1));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_set_frame_id(publisher, name));
  EXPECT(NUNET_OK, nunet_publisher_set_frame_id(publisher, name + 1));
  lens[0] = 0.25;
  EXPECT(NUNET_OK, nunet_publisher_set_camera(publisher, 8, 9, 1.5, 1, 1, lens, 5));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_publish(publisher, lens, 5, 0, 0));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_publish(publisher, NULL, 36, 0, 0));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_publish(publisher, lens, 36, 9, 0));
}

static void read_back(nunet_reader_t *reader, const unsigned char *image, uint64_t sequence) {
  nunet_frame_t *frame;
  const nunet_header_t *header;
  const void *bytes;
  size_t count;
  EXPECT(NUNET_OK, nunet_reader_next(reader, RGB, 30000, &frame));
  EXPECT(NUNET_OK, nunet_frame_header(frame, &header));
  EXPECT(NUNET_OK, nunet_frame_bytes(frame, &bytes, &count));
  HOLDS((size_t)bytes % 64 == 0 && count == 36 && memcmp(bytes, image, count) == 0);
  HOLDS(header->sequence == sequence && header->width == 4 && header->height == 3);
  HOLDS(header->encoding == NUNET_ENCODING_BGR8 && header->row_stride_bytes == 12 && header->payload_bytes == 36);
  HOLDS(header->capture_clock == NUNET_CLOCK_UNIX && header->capture_nanos == 77);
  HOLDS(header->capture_unix_nanos == 77 && header->publish_nanos <= nunet_monotonic_nanos());
  HOLDS(header->fx == 8 && header->fy == 9 && header->cx == 1.5 && header->cy == 1);
  HOLDS(header->distortion_model == NUNET_DISTORTION_MODEL_BROWN_CONRADY && header->distortion[0] == 0.25);
  HOLDS(header->frame_id[0] == 'x' && header->frame_id[63] == 'x');
  EXPECT(NUNET_OK, nunet_frame_release(frame));
}

static void publishing(const char *own) {
  nunet_publisher_t *publisher, *second;
  nunet_reader_t *reader, *excess;
  nunet_loan_t *loan, *more;
  nunet_header_t *header;
  unsigned char image[36];
  size_t index, count;
  void *bytes;
  nunet_frame_t *frame;
  bool woken;
  for (index = 0; index < sizeof image; index++) image[index] = (unsigned char)(index * 7);
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_open(own, NUNET_ENCODING_DEPTH_F32, 4, 3, 0, &publisher));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_open(own, 99, 4, 3, 0, &publisher));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_open(own, NUNET_ENCODING_RGB8, 0, 3, 0, &publisher));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_open(own, NUNET_ENCODING_RGB8, 4, 3, 1000, &publisher));
  EXPECT(NUNET_OK, nunet_publisher_open(own, NUNET_ENCODING_BGR8, 4, 3, 1, &publisher));
  EXPECT(NUNET_ALREADY_PUBLISHED, nunet_publisher_open(own, NUNET_ENCODING_BGR8, 4, 3, 1, &second));
  HOLDS(second == NULL && !nunet_publisher_has_readers(publisher));
  publisher_arguments(publisher);

  EXPECT(NUNET_OK, nunet_reader_open(own, NUNET_BIT_RGB, 30000, &reader));
  EXPECT(NUNET_TOO_MANY_READERS, nunet_reader_open(own, NUNET_BIT_RGB, 0, &excess));
  HOLDS(nunet_publisher_has_readers(publisher));
  EXPECT(NUNET_BAD_ARGUMENT, nunet_publisher_publish(publisher, image, 36, NUNET_CLOCK_UNIX, -1));
  EXPECT(NUNET_TIMEOUT, nunet_reader_next(reader, RGB, 0, &frame));
  EXPECT(NUNET_OK, nunet_publisher_publish(publisher, image, 36, NUNET_CLOCK_UNIX, 77));
  read_back(reader, image, 0);

  EXPECT(NUNET_OK, nunet_publisher_loan(publisher, &loan));
  EXPECT(NUNET_TOO_MANY_LOANS, nunet_publisher_loan(publisher, &more));
  EXPECT(NUNET_TOO_MANY_LOANS, nunet_publisher_publish(publisher, image, 36, NUNET_CLOCK_UNIX, 77));
  EXPECT(NUNET_OK, nunet_loan_release(loan));
  EXPECT(NUNET_CLOSED, nunet_loan_release(loan));
  EXPECT(NUNET_OK, nunet_publisher_loan(publisher, &loan));
  EXPECT(NUNET_OK, nunet_loan_header(loan, &header));
  HOLDS(header->sequence == 1 && header->width == 4 && header->payload_bytes == 36);
  header->sequence = 1000;
  EXPECT(NUNET_OK, nunet_loan_bytes(loan, &bytes, &count));
  HOLDS(count == 36);
  memcpy(bytes, image, count);
  EXPECT(NUNET_OK, nunet_loan_send(loan, NUNET_CLOCK_UNIX, 77));
  EXPECT(NUNET_CLOSED, nunet_loan_send(loan, NUNET_CLOCK_UNIX, 77));
  EXPECT(NUNET_CLOSED, nunet_loan_header(loan, &header));
  EXPECT(NUNET_OK, nunet_reader_wait(reader, 0, &woken));
  read_back(reader, image, 1000);
  EXPECT(NUNET_OK, nunet_publisher_loan(publisher, &loan));
  EXPECT(NUNET_OK, nunet_loan_header(loan, &header));
  HOLDS(header->sequence == 1001);

  EXPECT(NUNET_OK, nunet_publisher_refresh(publisher));
  EXPECT(NUNET_OK, nunet_publisher_close(publisher));
  EXPECT(NUNET_CLOSED, nunet_publisher_close(publisher));
  EXPECT(NUNET_CLOSED, nunet_publisher_loan(publisher, &more));
  EXPECT(NUNET_CLOSED, nunet_loan_send(loan, NUNET_CLOCK_UNIX, 77));
  EXPECT(NUNET_OTHER_LIMITS, nunet_publisher_open(own, NUNET_ENCODING_BGR8, 4, 3, 9, &publisher));
  EXPECT(NUNET_OK, nunet_publisher_open(own, NUNET_ENCODING_BGR8, 4, 3, 1, &publisher));
  EXPECT(NUNET_OK, nunet_reader_close(reader));
  EXPECT(NUNET_OK, nunet_publisher_close(publisher));
}

static void on_alarm(int number) { (void)number; }

static void signals(const char *own) {
  nunet_publisher_t *publisher;
  nunet_reader_t *reader;
  nunet_frame_t *frame;
  struct sigaction action;
  struct itimerval timer;
  memset(&action, 0, sizeof action);
  memset(&timer, 0, sizeof timer);
  action.sa_handler = on_alarm;
  timer.it_value.tv_usec = 30000;
  timer.it_interval.tv_usec = 30000; /* again, in case the first one arrives between two sleeps */
  EXPECT(NUNET_OK, nunet_publisher_open(own, NUNET_ENCODING_MONO8, 4, 3, 0, &publisher));
  EXPECT(NUNET_OK, nunet_reader_open(own, NUNET_BIT_RGB, 30000, &reader));
  EXPECT(NUNET_TIMEOUT, nunet_reader_next(reader, RGB, 150, &frame));
  HOLDS(strstr(nunet_last_error(), "its publisher is alive") != NULL);
  HOLDS(sigaction(SIGALRM, &action, NULL) == 0 && setitimer(ITIMER_REAL, &timer, NULL) == 0);
  EXPECT(NUNET_INTERRUPTED, nunet_reader_next(reader, RGB, NUNET_FOREVER, &frame));
  memset(&timer, 0, sizeof timer);
  HOLDS(setitimer(ITIMER_REAL, &timer, NULL) == 0);
  EXPECT(NUNET_OK, nunet_reader_close(reader));
  EXPECT(NUNET_OK, nunet_publisher_close(publisher));
}

static void *next_forever(void *reader) {
  nunet_frame_t *frame;
  EXPECT(NUNET_CLOSED, nunet_reader_next(reader, RGB, NUNET_FOREVER, &frame));
  HOLDS(frame == NULL);
  return NULL;
}

static void *wait_forever(void *reader) {
  nunet_status_t status;
  do {
    status = nunet_reader_wait(reader, NUNET_FOREVER, NULL); /* a publisher that starts may wake it */
  } while (status == NUNET_OK);
  EXPECT(NUNET_CLOSED, status);
  return NULL;
}

/* A thread that waits with a reader returns when another thread closes the reader. */
static void closing_under_a_waiter(const char *own, void *(*wait)(void *)) {
  nunet_publisher_t *publisher;
  nunet_reader_t *reader;
  struct timespec pause = {0, 50 * 1000000L};
  pthread_t thread;
  EXPECT(NUNET_OK, nunet_publisher_open(own, NUNET_ENCODING_MONO8, 4, 3, 0, &publisher));
  EXPECT(NUNET_OK, nunet_reader_open(own, NUNET_BIT_RGB, 30000, &reader));
  HOLDS(pthread_create(&thread, NULL, wait, reader) == 0);
  nanosleep(&pause, NULL);
  EXPECT(NUNET_OK, nunet_reader_close(reader));
  HOLDS(pthread_join(thread, NULL) == 0);
  EXPECT(NUNET_OK, nunet_publisher_close(publisher));
}

static void forks(const char *camera) {
  nunet_reader_t *reader;
  nunet_frame_t *frame;
  pid_t child;
  int status;
  EXPECT(NUNET_OK, nunet_reader_open(camera, NUNET_BIT_DEPTH, 30000, &reader));
  fflush(stdout);
  child = fork();
  if (child == 0) {
    failures = 0;
    EXPECT(NUNET_FORKED, nunet_reader_next(reader, DEPTH, 0, &frame));
    EXPECT(NUNET_OK, nunet_reader_close(reader));
    fflush(stdout);
    _exit(failures);
  }
  HOLDS(child > 0 && waitpid(child, &status, 0) == child && status == 0);
  EXPECT(NUNET_OK, nunet_reader_next(reader, DEPTH, 30000, &frame));
  EXPECT(NUNET_OK, nunet_frame_release(frame));
  EXPECT(NUNET_OK, nunet_reader_close(reader));
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  HOLDS(*nunet_last_error() == 0);
  HOLDS(strcmp(nunet_version(), NUNET_VERSION) == 0);
  HOLDS(nunet_contract_version() == NUNET_CONTRACT_VERSION);
  nulls();
  names();
  frames(argv[1]);
  publishing(argv[2]);
  signals(argv[2]);
  closing_under_a_waiter(argv[2], next_forever);
  closing_under_a_waiter(argv[2], wait_forever);
  forks(argv[1]);
  printf("%d failures\n", failures);
  return failures > 0;
}
