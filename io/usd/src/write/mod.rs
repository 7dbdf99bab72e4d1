//! Caches: binary value clips, one a frame, and the text layers that an artist opens.
