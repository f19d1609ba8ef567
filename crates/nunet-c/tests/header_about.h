/*
 * nunet.h: nunetd's depth, labels and clouds in shared memory, for C (C99) and C++.
 *
 * Written by crates/nunet-c/tests/header.rs; change the source, not this file.
 *
 * RESULTS. Functions answer NUNET_OK (0) or what went wrong; nunet_last_error() says it in words, with a hint. No
 * function exits, throws or prints (but a fault of the library's own prints where it happened). docs/book/shared-memory.md has the
 * lines to compile and link with.
 *
 * OWNERSHIP. Handles (reader, frame, publisher, loan) belong to the caller until closed, released or sent. A handle
 * that is used after its end is an error (NUNET_CLOSED), not a crash; so is one of another kind. Memory that a frame
 * or a loan points at belongs to the library, and ends with the frame or loan: pointers kept longer are wild. Texts
 * and arrays that are passed in are copied, and must be what the description says: ended by a zero byte, as long as
 * said.
 *
 * NULL. Where a result goes must not be NULL, unless its description says that it may be. After a failure handles and
 * pointers that were to be given are NULL.
 *
 * THREADS. Everything may be called by any thread. Calls with the same reader, or the same publisher, come one after
 * the other. Any thread may read and release a frame, when nobody else still looks into it. Signal handlers must call
 * nothing here.
 *
 * FORK. Open after forking: what was open before belongs to the parent, and is NUNET_FORKED in the child.
 *
 * UNITS. Depth in metres where the header's `units` says so, NaN where there is no measurement; times in
 * nanoseconds, timeouts in milliseconds, sizes and intrinsics in pixels.
 *
 * END. Close what is open before the process ends. What a killed process leaves is cleaned up by the next one that
 * opens the camera.
 */
