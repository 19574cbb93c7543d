//! Visibility fields: *is anything in the way between this point and that direction?*, answered by look-ups, not triangles.
//!
//! A [`VisibilityField`] is baked once per rigid mesh (crate `visfield_bake`) and shared by all its instances, under any
//! invertible affine transform. The data's path through this crate:
//!
//! 1. [`file`](mod@file) decodes a field from untrusted bytes, and encodes it,
//! 2. [`field`] answers single rays and batches in *field space*, where the mesh's bounding ellipsoid is the unit sphere, by a field's
//!    table, or by its [distances](mod@distance); and ambient occlusion without rays by its [cap grid](CapGrid),
//! 3. [`scene`] places instances of fields in a world,
//! 4. [`raycast`] answers a game's own rays against a whole scene,
//! 5. [`estimate`] turns many rays into ambient occlusion and the soft shadows of lights on the CPU, and combines the cap grids of a
//!    scene,
//! 6. [`gpu`](mod@gpu) (feature `gpu`) does the same for every pixel of a frame, in plain WGSL compute passes.
//!
//! Beside it, [`shape`] describes solids by formulas instead of tables, and gives the distance to them.
//!
//! *Occlusion* is 0 where nothing is in the way and 1 where everything is; *visibility* is 1 − occlusion.
//!
//! The method follows Gaitatzes et al., *Presampled Visibility for Ambient Occlusion* (2008) and *Fast Approximate
//! Visibility on the GPU using Pre-Computed 4D Visibility Fields* (2010); where this crate deviates, the item says so.
//!
//! ```
//! use glam::{DAffine3, Vec3};
//! use visfield::{estimate, scene::{Instance, Scene}};
//! # let field = visfield::field::example_field();
//! // One field, two instances; how much of its sky does a point between them see?
//! let mut scene = Scene::default();
//! let id = scene.add_field(field);
//! scene.instances.push(Instance::new(id, DAffine3::from_translation(glam::dvec3(2.0, 0.0, 0.0))));
//! scene.instances.push(Instance::new(id, DAffine3::from_translation(glam::dvec3(-2.0, 0.0, 0.0))));
//! let receiver = estimate::Receiver { position: glam::DVec3::ZERO, normal: Vec3::Z };
//! let occlusion = estimate::ambient_occlusion(&scene, &receiver, &estimate::AmbientOcclusion::default());
//! assert!((0.0..=1.0).contains(&occlusion));
//! ```

pub mod distance;
pub mod estimate;
pub mod field;
pub mod file;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod raycast;
pub mod scene;
pub mod shape;

pub use field::query::{QueryOptions, Ray};
pub use field::{
    BoundingEllipsoid, CapGrid, CapGridFormat, ChordTable, Encoding, FieldError, FieldHeader, FieldParts,
    Representation, TableFormat, VisibilityField,
};
