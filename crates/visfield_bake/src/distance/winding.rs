//! How often a surface winds around a point: what tells inside from outside.
//!
//! The generalised winding number of Jacobson et al., *Robust Inside-Outside Segmentation using Generalized Winding Numbers*
//! (2013, eq. 5) is the sum of the triangles' signed solid angles over 4π. Around closed surfaces it is a whole number: 1 inside
//! if triangles are anticlockwise from outside, −1 if clockwise, 0 outside, 2 where two bodies of one orientation overlap.
//! Where a surface has holes it is a fraction that changes smoothly through them, and near a single triangle or plate it stays
//! between −½ and ½, so that nothing is inside.
//!
//! Its limits: of two shells within each other, the inner one encloses a cavity if the two are oriented oppositely, and
//! nothing special if they are oriented alike. Where neighbouring triangles disagree about their orientation they cancel,
//! and what they enclose may count as outside.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::closest::Surface;

/// Winding numbers of a surface, by a hierarchy of dipoles.
///
/// Groups of triangles that are far away for their size count as one dipole (Barill et al., *Fast Winding Numbers for Soups
/// and Clouds*, 2018, §3.1). One term of their expansion is enough to tell ½ from 0 and 1; the errors are a few hundredths.
#[derive(Debug)]
pub(crate) struct WindingNumbers<'a> {
    surface: &'a Surface,
    /// One for each node of the BVH.
    dipoles: Vec<Dipole>,
}

/// What a group of triangles looks like from afar.
#[derive(Clone, Copy, Debug, Default)]
struct Dipole {
    /// Mean of the triangles' centres, weighted by area.
    center: DVec3,
    area: f64,
    /// Sum of the triangles' normals, as long as their areas.
    moment: DVec3,
    /// Of a sphere around the centre that holds all corners.
    radius: f64,
}

/// How many radii away a group is far enough to count as one (β in Barill et al. 2018, §3.2, who recommend this value).
const FAR: f64 = 2.0;

impl<'a> WindingNumbers<'a> {
    /// Sums up the groups of triangles.
    pub(crate) fn new(surface: &'a Surface) -> Self {
        let nodes = surface.nodes();
        // Children after their parents.
        let mut order = Vec::with_capacity(nodes.len());
        order.extend((!nodes.is_empty()).then_some(0));
        let mut next = 0;
        while let Some(&index) = order.get(next) {
            let node = &nodes[index as usize];
            if node.count == 0 {
                order.extend([node.first, node.first + 1]);
            }
            next += 1;
        }
        let mut dipoles = vec![Dipole::default(); nodes.len()];
        for &index in order.iter().rev() {
            let node = &nodes[index as usize];
            let first = node.first as usize;
            dipoles[index as usize] = if node.count == 0 {
                Dipole::of_children([dipoles[first], dipoles[first + 1]])
            } else {
                Dipole::of_triangles(&surface.triangles()[first..first + node.count as usize])
            };
        }
        Self { surface, dipoles }
    }

    /// The winding number around a point, with an error of a few hundredths.
    pub(crate) fn at(&self, point: Vec3) -> f64 {
        let point = point.as_dvec3();
        let (nodes, triangles) = (self.surface.nodes(), self.surface.triangles());
        let mut sum = 0.0;
        let mut pending = Vec::with_capacity(64);
        pending.extend((!nodes.is_empty()).then_some(0));
        while let Some(index) = pending.pop() {
            let (node, dipole) = (&nodes[index as usize], &self.dipoles[index as usize]);
            let away = dipole.center - point;
            let squared = away.length_squared();
            if squared > FAR * FAR * dipole.radius * dipole.radius {
                sum += away.dot(dipole.moment) / (squared * squared.sqrt());
            } else if node.count == 0 {
                pending.extend([node.first, node.first + 1]);
            } else {
                let leaf = &triangles[node.first as usize..(node.first + node.count) as usize];
                sum += leaf.iter().map(|corners| solid_angle(corners.map(|p| p.as_dvec3() - point))).sum::<f64>();
            }
        }
        sum / (2.0 * TAU)
    }
}

impl Dipole {
    fn of_triangles(triangles: &[[Vec3; 3]]) -> Self {
        let mut sum = Self::default();
        let mut middle = DVec3::ZERO;
        for [a, b, c] in triangles.iter().map(|corners| corners.map(Vec3::as_dvec3)) {
            let normal = (b - a).cross(c - a) * 0.5;
            let center = (a + b + c) / 3.0;
            sum.moment += normal;
            sum.area += normal.length();
            sum.center += center * normal.length();
            middle += center;
        }
        sum.center = if sum.area > 0.0 { sum.center / sum.area } else { middle / triangles.len() as f64 };
        let distances = triangles.as_flattened().iter().map(|p| p.as_dvec3().distance_squared(sum.center));
        sum.radius = distances.fold(0.0, f64::max).sqrt();
        sum
    }

    fn of_children(children: [Self; 2]) -> Self {
        let area = children[0].area + children[1].area;
        let share = if area > 0.0 { children[1].area / area } else { 0.5 };
        let center = children[0].center.lerp(children[1].center, share);
        let radius = children.map(|child| child.center.distance(center) + child.radius);
        let moment = children[0].moment + children[1].moment;
        Self { center, area, moment, radius: radius[0].max(radius[1]) }
    }
}

/// The signed solid angle of a triangle around the origin, positive if its corners are clockwise from there (Van Oosterom &
/// Strackee, *The Solid Angle of a Plane Triangle*, 1983, eq. 8).
pub(crate) fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let [length_a, length_b, length_c] = [a, b, c].map(DVec3::length);
    let numerator = a.dot(b.cross(c));
    let denominator = length_a * length_b * length_c + a.dot(b) * length_c + b.dot(c) * length_a + c.dot(a) * length_b;
    2.0 * numerator.atan2(denominator)
}
