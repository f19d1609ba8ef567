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
