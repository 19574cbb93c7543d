//! Bakes meshes into visibility fields (`visfield`), by tracing rays through a triangle BVH.
//!
//! The data's path through this crate:
//!
//! 1. [`read`](mod@read) takes meshes from `.glb`, `.gltf` and `.obj` files,
//! 2. [`mesh`] checks that a triangle soup can be baked,
//! 3. [`bounds`] finds the sphere or ellipsoid that becomes the unit sphere of field space,
//! 4. [`triangles`] answers exact rays (crate `obvhs`; no other module knows it),
//! 5. [`bake`](mod@bake) traces every chord of the table, and fits the cap grid to what is seen from around the mesh.
//!
//! [`tune`](mod@tune) chooses the table by measuring what it gets wrong on that very mesh.
//!
//! [`exact`] gives the same estimates as `visfield::estimate` by exact rays: what a field's answers are measured against.
//!
//! ```
//! use visfield::{QueryOptions, Ray};
//! use visfield_bake::{BakeSettings, Mesh, bake};
//! let mesh = Mesh {
//!     name: "Mesh0/Primitive0".to_owned(),
//!     positions: vec![[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]],
//!     indices: vec![[0, 1, 2]],
//! };
//! let field = bake(&mesh, &BakeSettings::two_point(17, 16), |_| ())?;
//! let down = Ray::new(glam::vec3(0.0, 0.5, 0.0), glam::vec3(0.0, -1.0, 0.0));
//! assert!((field.hit(&down, &QueryOptions::default()).unwrap() - 0.5).abs() < 0.1);
//! # Ok::<(), visfield_bake::BakeError>(())
//! ```

pub mod bake;
pub mod bounds;
mod cap_grid;
mod distance;
pub mod exact;
pub mod measure;
pub mod mesh;
pub mod read;
#[cfg(feature = "command")]
pub mod report;
pub mod triangles;
pub mod tune;

pub use bake::{BakeError, BakeSettings, bake};
pub use bounds::{BoundsKind, bounding_ellipsoid, bounding_sphere};
pub use exact::ExactScene;
pub use mesh::{Mesh, MeshError};
pub use read::{ReadError, read_meshes};
pub use triangles::{PreparedRay, TriangleBvh};
