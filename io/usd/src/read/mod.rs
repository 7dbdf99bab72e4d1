//! Stages: meshes with their transforms, time samples and skeletons.
