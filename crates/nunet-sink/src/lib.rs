//! What the outputs of `nunetd` share.
//!
//! | module | what it contains |
//! |---|---|
//! | [`queue`] | a thread behind a bounded queue, for outputs that write to disks or networks |
//! | [`results`] | what outputs take of a frame |
//! | [`record`], [`archive`] | a copy of a frame with its results, and the thread that writes copies to a disk |
//! | [`obstacles`] | the stage that finds obstacles, only for frames whose obstacles something takes |
//! | [`obstacle_record`] | obstacles as they lie in shared memory |
//! | [`obstacle_images`] | obstacles of single images, as files |

pub mod archive;
pub mod obstacle_images;
pub mod obstacle_record;
pub mod obstacles;
pub mod queue;
pub mod record;
pub mod results;
