//! Convex solids between facets: as shapes, and exactly, to tell where light goes in them.

use glam::{DVec3, Quat, Vec3, dvec3};
use visfield::shape::Shape;

/// How much slower light is in glass than outside.
const REFRACTION: f64 = 1.5;

/// What is below all of some planes: unit normals, and how far each is from the origin.
#[derive(Clone)]
pub(super) struct Facets(Vec<(DVec3, f64)>);

/// Where light is, and where it goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    pub(super) position: DVec3,
    pub(super) direction: DVec3,
}

impl Facets {
    /// A cut stone of about radius 1: a table, a crown, a girdle and a pavilion of eight facets each.
    pub(super) fn jewel(scale: f64) -> Self {
        let ring = |elevation: f64, offset: f64, turn: f64| {
            (0..8).map(move |i| {
                let around = (f64::from(i) + turn) * std::f64::consts::FRAC_PI_4;
                let (sin, cos) = elevation.to_radians().sin_cos();
                (dvec3(cos * around.cos(), sin, cos * around.sin()), offset * scale)
            })
        };
        let table = std::iter::once((DVec3::Y, 0.5 * scale));
        Self(table.chain(ring(40.0, 0.85, 0.5)).chain(ring(0.0, 1.0, 0.0)).chain(ring(-45.0, 0.78, 0.0)).collect())
    }

    /// The paper's (2014, Figure 11), of about radius 1.
    pub(super) fn dodecahedron() -> Self {
        let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
        let signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
        let normals = signs
            .into_iter()
            .flat_map(|(a, b)| [dvec3(0.0, a, b * golden), dvec3(a, b * golden, 0.0), dvec3(b * golden, 0.0, a)]);
        Self(normals.map(|normal| (normal.normalize(), 0.8)).collect())
    }

    pub(super) fn shape(&self) -> Shape {
        let half_space = |&(normal, offset): &(DVec3, f64)| {
            Shape::HalfSpace
                .turned(Quat::from_rotation_arc(Vec3::Y, normal.as_vec3()))
                .moved((normal * offset).as_vec3())
        };
        Shape::Intersection(self.0.iter().map(half_space).collect())
    }

    /// The normal of the facet whose plane is the farthest below a point, or the least above it.
    pub(super) fn normal(&self, position: Vec3) -> Vec3 {
        let height = |&(normal, offset): &(DVec3, f64)| normal.dot(position.as_dvec3()) - offset;
        let highest = self.0.iter().max_by(|a, b| height(a).total_cmp(&height(b)));
        highest.expect("there are facets").0.as_vec3()
    }

    /// Where a beam from outside enters, and the normal there.
    pub(super) fn entry(&self, beam: Beam) -> Option<(f64, DVec3)> {
        let (mut entry, mut exit) = ((f64::NEG_INFINITY, DVec3::ZERO), f64::INFINITY);
        for &(normal, offset) in &self.0 {
            let (slope, t) = (normal.dot(beam.direction), self::crossing(normal, offset, beam));
            if slope < 0.0 && t > entry.0 {
                entry = (t, normal);
            } else if slope > 0.0 {
                exit = exit.min(t);
            }
        }
        (entry.0 < exit && entry.0 > 0.0).then_some(entry)
    }

    /// Where a beam from inside leaves, and the normal there.
    pub(super) fn exit(&self, beam: Beam) -> (f64, DVec3) {
        let ahead = self.0.iter().filter(|(normal, _)| normal.dot(beam.direction) > 0.0);
        let crossings = ahead.map(|&(normal, offset)| (crossing(normal, offset, beam), normal));
        crossings.min_by(|a, b| a.0.total_cmp(&b.0)).expect("the solid is bounded")
    }

    /// The beams inside that one from outside becomes, in turn, and the direction in which it leaves: none if after `most` it is
    /// still inside.
    pub(super) fn path(&self, beam: Beam, most: usize) -> (Vec<Beam>, Option<DVec3>) {
        let Some((t, normal)) = self.entry(beam) else { return (Vec::new(), Some(beam.direction)) };
        let mut inside =
            Beam { position: beam.position + beam.direction * t, direction: enter(beam.direction, normal) };
        let mut beams = Vec::new();
        for _ in 0..most {
            beams.push(inside);
            let (t, normal) = self.exit(inside);
            match leave(inside.direction, normal) {
                Ok(direction) => return (beams, Some(direction)),
                Err(direction) => inside = Beam { position: inside.position + inside.direction * t, direction },
            }
        }
        (beams, None)
    }
}

fn crossing(normal: DVec3, offset: f64, beam: Beam) -> f64 {
    (offset - normal.dot(beam.position)) / normal.dot(beam.direction)
}

/// The direction of light in the solid, from that outside.
pub(super) fn enter(direction: DVec3, normal: DVec3) -> DVec3 {
    direction.refract(normal, 1.0 / REFRACTION).normalize()
}

/// The direction of light outside, or, where it is wholly reflected, inside.
pub(super) fn leave(direction: DVec3, normal: DVec3) -> Result<DVec3, DVec3> {
    let out = direction.refract(-normal, REFRACTION);
    if out == DVec3::ZERO { Err(direction.reflect(normal).normalize()) } else { Ok(out.normalize()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use visfield::estimate::sampling::sphere_samples;
    use visfield::shape::ShapeProgram;

    #[test]
    fn shapes_are_as_the_facets_say() {
        for facets in [Facets::jewel(1.0), Facets::dodecahedron()] {
            let mut own_facet = 0;
            let program = ShapeProgram::new(&facets.shape(), 1.0).unwrap();
            for sample in sphere_samples(300) {
                let beam = Beam { position: DVec3::ZERO, direction: sample.as_dvec3() };
                let (exit, normal) = facets.exit(beam);
                let on = beam.direction * exit;
                assert!(program.distance(on.as_vec3()).abs() < 1e-5);
                own_facet += u32::from(facets.normal(on.as_vec3()).dot(normal.as_vec3()) > 0.999);
                let outside = Beam { position: beam.direction * 3.0, direction: -beam.direction };
                assert!((facets.entry(outside).unwrap().0 - (3.0 - exit)).abs() < 1e-9);
            }
            assert!(own_facet > 295, "all but those on edges: {own_facet}");
        }
    }

    #[test]
    fn light_is_bent_in_and_out_and_reflected() {
        let cube = Facets([DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|n| [(n, 1.0), (-n, 1.0)]).collect());
        let direction = dvec3(0.2, -1.0, 0.1).normalize();
        let (beams, out) = cube.path(Beam { position: dvec3(0.0, 3.0, 0.0), direction }, 8);
        assert_eq!(beams.len(), 1);
        // Through a plate, light keeps its direction.
        assert!((out.unwrap() - direction).length() < 1e-9);
        assert!((beams[0].direction.y / direction.y).abs() > 1.0, "steeper inside");
        assert!(leave(dvec3(1.0, 1.0, 0.0).normalize(), DVec3::Y).is_err());
    }
}
