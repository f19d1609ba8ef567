//! The outputs of `nunetd` besides shared memory, and their common parts.
//!
//! | module | content |
//! |---|---|
//! | [`sink`] | the trait of all outputs, and what the stream passes to it |
//! | [`queue`] | a thread behind a bounded queue, for outputs that write to disks or networks |
//! | [`results`] | the results of a frame that outputs receive |
//! | [`record`], [`archive`] | a copy of a frame with its results, and the thread that writes copies to a disk |
//! | [`recorder`], [`frame_writer`], [`output_file`] | recordings in MCAP files |
//! | [`image_encoder`] | images as JPEG or PNG |
//! | [`file_plan`] | checks that no file is both read and written, or written twice |
//! | [`output_paths`] | the paths of a run's outputs: checked before anything slow, created last |
//! | [`last_frame`], [`file_writer`] | the results of the last frame as files; a thread that writes files |
//! | [`stdout`] | results on standard output, and log lines |
//! | [`metrics`], [`view`] | counts and latencies for Prometheus; frames for the live view |
//! | [`empty_depth`] | a warning about depth maps without valid depth |
//! | [`image_check`] | warnings about the results of a single image |
//! | [`stats_record`] | counts and latencies as stored in shared memory |
//! | [`watch_text`] | a frame and its stats as text |
//! | [`stability`] | a warning about depth that drifts or flickers while the image does not change |
//! | [`error_kind`] | the kinds of this crate's errors |
//! | [`attitude`] | the mount of each frame on a robot that pitches or rolls |
//! | [`mount_option`] | the pose of a camera, as six numbers |
//! | [`mavlink`] | obstacles for an autopilot |
//! | [`obstacles`] | the stage that finds obstacles, only for frames whose obstacles a reader or a sink needs |
//! | [`obstacle_record`] | obstacles as stored in shared memory |
//! | [`obstacle_images`] | obstacles of one frame, as files |

pub mod archive;
pub mod attitude;
pub mod empty_depth;
pub mod error_kind;
pub mod file_plan;
pub mod file_writer;
pub mod frame_writer;
pub mod image_check;
pub mod image_encoder;
pub mod last_frame;
pub mod mavlink;
pub mod metrics;
mod mount_check;
pub mod mount_option;
pub mod obstacle_images;
pub mod obstacle_record;
pub mod obstacles;
pub mod output_file;
pub mod output_paths;
pub mod queue;
pub mod record;
pub mod recorder;
pub mod results;
pub mod sink;
pub mod stability;
pub mod stats_record;
pub mod stdout;
pub mod view;
pub mod watch_text;
