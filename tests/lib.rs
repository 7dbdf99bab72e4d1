//! Shared pieces of Drapery's tests.
