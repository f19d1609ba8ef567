//! Obstacles for autopilots such as PX4 and ArduPilot: MAVLink's `OBSTACLE_DISTANCE`.
//!
//! | module | content |
//! |---|---|
//! | `address` | the address of the autopilot: [`MavlinkAddress`] |
//! | `ring` | sectors as 72 distances around the vehicle: [`DistanceRing`] |
//! | `messages` | the bytes of messages |
//! | `lookup` | the addresses of a host |
//! | `link` | a connection that is reopened after a failure: [`MavlinkLink`] |
//!
//! # Example: an obstacle to the right
//! ```
//! use nunet_mavlink::{DistanceRing, UNKNOWN_CM};
//! use nunet_types::{ObstacleSector, SectorState};
//!
//! // Four sectors of 10 degrees, counterclockwise from 20 degrees to the right; range 5 m.
//! let free = ObstacleSector { state: SectorState::Free.into(), range_m: 5.0, ..ObstacleSector::UNKNOWN };
//! let occupied = ObstacleSector { state: SectorState::Occupied.into(), range_m: 1.5, ..free };
//! let mut ring = DistanceRing::default();
//! ring.fill(&[occupied, free, free, free], [-20_f32.to_radians(), 10_f32.to_radians()], 5.0);
//!
//! assert_eq!(ring.max_cm, 450); // free up to 0.9 of the range
//! assert_eq!(ring.distances_cm[0], 451); // forward: free
//! assert_eq!(ring.distances_cm[3], 150); // 15 degrees to the right, clockwise
//! assert_eq!(ring.distances_cm[36], UNKNOWN_CM); // behind: not in view
//! ```

mod address;
mod link;
mod lookup;
mod messages;
mod ring;

pub use address::{AddressError, MavlinkAddress, MavlinkErrorKind, MavlinkTransport};
pub use link::{LinkEvent, MavlinkLink};
pub use ring::{BINS, DistanceRing, UNKNOWN_CM};
