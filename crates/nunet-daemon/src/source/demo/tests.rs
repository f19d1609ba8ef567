//! The room against its own geometry, computed another way.
