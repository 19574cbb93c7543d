//! The thesis' scenes: things that stand on a ground, as triangles for exact rays, and as distances.

use glam::{Affine3A, DAffine3, DVec3, Vec3};
use visfield::distance::DistanceField;
use visfield::distance::cone::LightCone;
use visfield::estimate::Receiver;
use visfield::field::query::Bias;
use visfield::shape::{Shape, ShapeProgram};
use visfield::{QueryOptions, Ray, VisibilityField};

use super::Paper2012Question;
use crate::bake::{BakeError, BakeSettings};
use crate::bounds::bounding_sphere;
use crate::exact::ExactScene;
use crate::measure::progress::Progress;
use crate::measure::scene::own_surface;
use crate::mesh::{Mesh, MeshError};

/// Side of the square of ground with receivers, in radii of the first object.
const GROUND_SIZE: f64 = 5.0;
/// How far its centre is from below the first object, along x and z: away from the light, where shadows fall.
const GROUND_SHIFT: f64 = -0.8;
/// Half the side of the ground that exact rays meet.
const GROUND_HALF: f32 = 100.0;
/// Quads along each edge of what triangles make of balls and boxes.
const CUBE_SIDE: u32 = 24;
/// Half the edges of the box.
const BOX: [f32; 3] = [0.6, 0.75, 0.6];

/// What stands on the ground.
pub(super) struct Object {
    mesh: Mesh,
    scene_from_mesh: DAffine3,
    field: VisibilityField,
    field_from_scene: Affine3A,
    distance_from_scene: Affine3A,
    /// Units of the distances for one of the scene.
    scale: f32,
    /// In the scene, if it is known in closed form; else the baked distances stand for it.
    shape: Option<ShapeProgram>,
}

/// Units are radii of the first object, which is centred above the origin.
pub(super) struct Scene {
    pub(super) name: String,
    pub(super) objects: Vec<Object>,
    pub(super) exact: ExactScene,
    /// Row by row.
    pub(super) ground: Vec<Receiver>,
    pub(super) surface: Vec<Receiver>,
}

/// A cube from −1 to 1 of many quads, each vertex put elsewhere.
fn cube(name: &str, place: impl Fn(Vec3) -> Vec3) -> Mesh {
    let mut mesh = Mesh { name: name.to_owned(), ..Mesh::default() };
    let row = CUBE_SIDE + 1;
    for (normal, across) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for side in [1.0, -1.0] {
            // Turned with the side, so that all triangles wind the same way around.
            let (normal, along) = (normal * side, normal.cross(across));
            let first = mesh.positions.len() as u32;
            let at = |i: u32| i as f32 / CUBE_SIDE as f32 * 2.0 - 1.0;
            let points = (0..row * row).map(|i| normal + across * (at(i % row) * side) + along * at(i / row));
            mesh.positions.extend(points.map(|point| place(point).to_array()));
            for corner in (0..CUBE_SIDE * CUBE_SIDE).map(|i| first + i / CUBE_SIDE * row + i % CUBE_SIDE) {
                let [a, b, c, d] = [corner, corner + 1, corner + row + 1, corner + row];
                mesh.indices.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    mesh
}

impl Object {
    fn new(
        mesh: Mesh,
        place: impl FnOnce(&Mesh) -> Result<DAffine3, MeshError>,
        shape: Option<Shape>,
        question: &Paper2012Question,
        progress: &Progress,
    ) -> Result<Self, BakeError> {
        let field = progress.bake(&mesh, &BakeSettings::of_distance(question.distance))?;
        let mesh_error = |source| BakeError::Mesh { name: mesh.name.clone(), source };
        let scene_from_mesh = place(&mesh).map_err(mesh_error)?;
        let field_from_scene = field.header().bounds.field_from_mesh() * scene_from_mesh.inverse();
        let distances = field.distance_field().ok_or_else(|| BakeError::NoTable { name: mesh.name.clone() })?;
        let distance_from_scene = distances.distance_from_mesh() * scene_from_mesh.inverse();
        let program = |shape: Shape| ShapeProgram::new(&shape, 1.0).expect("balls and boxes of these sizes are shapes");
        Ok(Self {
            scene_from_mesh,
            field_from_scene: field_from_scene.as_affine3a(),
            distance_from_scene: distance_from_scene.as_affine3a(),
            scale: distance_from_scene.matrix3.x_axis.x as f32,
            shape: shape.map(program),
            mesh,
            field,
        })
    }

    fn ball(question: &Paper2012Question, progress: &Progress) -> Result<Self, BakeError> {
        let mesh = cube("sphere", |point| point.normalize() + Vec3::Y);
        let shape = Shape::Sphere { radius: 1.0 }.moved(Vec3::Y);
        Self::new(mesh, |_| Ok(DAffine3::IDENTITY), Some(shape), question, progress)
    }

    fn cuboid(center: Vec3, question: &Paper2012Question, progress: &Progress) -> Result<Self, BakeError> {
        let center = center + Vec3::Y * BOX[1];
        let mesh = cube("box", |point| point * Vec3::from(BOX) + center);
        let shape = Shape::Box { half_extents: BOX }.moved(center);
        Self::new(mesh, |_| Ok(DAffine3::IDENTITY), Some(shape), question, progress)
    }

    /// A mesh, scaled to a radius of 1.
    fn model(mesh: &Mesh, question: &Paper2012Question, progress: &Progress) -> Result<Self, BakeError> {
        let place = |mesh: &Mesh| {
            let bounds = bounding_sphere(mesh)?;
            let center = DVec3::from(bounds.center.map(f64::from));
            let scale = 1.0 / bounds.mesh_from_field().matrix3.x_axis.x;
            let lowest =
                mesh.solid_triangles()?.as_flattened().iter().map(|corner| corner.y).fold(f64::INFINITY, f64::min);
            let below = DVec3::new(center.x, lowest, center.z);
            Ok(DAffine3::from_scale(DVec3::splat(scale)) * DAffine3::from_translation(-below))
        };
        Self::new(mesh.clone(), place, None, question, progress)
    }

    fn distances(&self) -> &DistanceField {
        self.field.distance_field().expect("only fields with distances become objects")
    }

    /// The signed distance in the scene.
    fn distance(&self, position: Vec3) -> f32 {
        match &self.shape {
            Some(shape) => shape.distance(position),
            None => self.distances().distance(self.distance_from_scene.transform_point3(position)) / self.scale,
        }
    }

    /// Triangle by triangle, its surface.
    fn receivers(&self, side: usize) -> Result<Vec<Receiver>, MeshError> {
        let mut receivers = own_surface(&self.mesh, side)?;
        for receiver in &mut receivers {
            // An even scale and a shift: normals stay.
            receiver.position = self.scene_from_mesh.transform_point3(receiver.position);
        }
        Ok(receivers)
    }

    /// Whether the baked distances are in the way of a ray.
    fn occluded(&self, position: Vec3, normal: Vec3, direction: Vec3) -> bool {
        let ray = Ray::new(
            self.field_from_scene.transform_point3(position),
            self.field_from_scene.transform_vector3(direction),
        );
        self.field.occluded(&ray, &QueryOptions { normal, ..QueryOptions::default() })
    }
}

impl Scene {
    fn new(name: String, objects: Vec<Object>, question: &Paper2012Question) -> Result<Self, BakeError> {
        let [low, high] = [-GROUND_HALF, GROUND_HALF];
        let ground = Mesh {
            name: "ground".to_owned(),
            positions: vec![[low, 0.0, low], [high, 0.0, low], [high, 0.0, high], [low, 0.0, high]],
            indices: vec![[0, 2, 1], [0, 3, 2]],
        };
        let mut instances: Vec<_> = objects.iter().map(|object| (&object.mesh, object.scene_from_mesh)).collect();
        instances.push((&ground, DAffine3::IDENTITY));
        let mesh_error = |source| BakeError::Mesh { name: name.clone(), source };
        let exact = ExactScene::new(&instances, DVec3::ZERO).map_err(mesh_error)?;
        let side = question.side;
        let at = |i: usize| (i as f64 / (side - 1) as f64 - 0.5) * GROUND_SIZE + GROUND_SHIFT;
        let place = |i: usize| Receiver { position: DVec3::new(at(i % side), 0.0, at(i / side)), normal: Vec3::Y };
        let mut surface = Vec::new();
        for object in &objects {
            surface.extend(object.receivers(question.surface_side).map_err(mesh_error)?);
        }
        // What stands on the ground has receivers in it too, which nothing can tell apart.
        surface.retain(|receiver| receiver.position.y > 1.0e-3);
        Ok(Self { name, exact, ground: (0..side * side).map(place).collect(), surface, objects })
    }

    /// The thesis' scenes with a mesh in the place of its bunny, and those of further meshes on the ground.
    pub(super) fn all(
        mesh: &Mesh,
        others: &[Mesh],
        question: &Paper2012Question,
        progress: &Progress,
    ) -> Result<Vec<Self>, BakeError> {
        let ball = Object::ball(question, progress)?;
        let cuboid = Object::cuboid(Vec3::ZERO, question, progress)?;
        let beside = Object::cuboid(Vec3::new(1.25, 0.0, -0.75), question, progress)?;
        let mut scenes = vec![
            Self::new("sphere".to_owned(), vec![ball], question)?,
            Self::new("box".to_owned(), vec![cuboid], question)?,
            Self::new(mesh.name.clone(), vec![Object::model(mesh, question, progress)?], question)?,
            Self::new(
                format!("{} and box", mesh.name),
                vec![Object::model(mesh, question, progress)?, beside],
                question,
            )?,
        ];
        for other in others {
            scenes.push(Self::new(other.name.clone(), vec![Object::model(other, question, progress)?], question)?);
        }
        Ok(scenes)
    }

    /// The signed distance to all of it.
    pub(super) fn distance(&self, position: Vec3) -> f32 {
        self.objects.iter().map(|object| object.distance(position)).fold(position.y, f32::min)
    }

    /// Whether the ground or the baked distances are in the way of a ray.
    pub(super) fn occluded(&self, receiver: &Receiver, direction: Vec3) -> bool {
        let position = receiver.position.as_vec3();
        direction.y < 0.0 || self.objects.iter().any(|object| object.occluded(position, receiver.normal, direction))
    }

    /// The share of a disc of the sky that is hidden, by cones through the baked distances of one object after the other.
    pub(super) fn cone_occlusion(&self, receiver: &Receiver, direction: Vec3, tangent: f32) -> f32 {
        let cone = LightCone { direction, tangent, t_light: f32::INFINITY };
        let seen = |object: &Object| {
            let position = object.distance_from_scene.transform_point3(receiver.position.as_vec3());
            1.0 - object.distances().cone_occlusion(position, receiver.normal, &cone, Bias::default())
        };
        1.0 - self.objects.iter().map(seen).product::<f32>()
    }
}
