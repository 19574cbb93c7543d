//! What of a shape is evaluated: a list of nodes for a stack machine. Twin: `shape_distance` in `shaders/shape.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, vec3};

use super::pose::Pose;
use super::primitive::{
    box_distance, capsule_distance, cone_distance, cylinder_distance, difference_distance, half_space_distance,
    intersection_distance, smooth_union_distance, sphere_distance, torus_distance, union_distance,
};
use super::{Shape, ShapeError};

/// Most nodes of a program: one for each primitive, and one for each joint of two.
pub const MAX_NODES: usize = 64;
/// Most distances that evaluation keeps at once.
pub const MAX_STACK: usize = 8;
/// Most shapes that may surround another, moves and scales included.
pub const MAX_NESTING: usize = 64;
/// Largest size of a primitive and distance from the origin, in units of the program: their squares are within the range of
/// `f32`, and so are those of positions as far away.
pub const MAX_LENGTH: f64 = 1.0e12;
/// The distance to nothing, and the largest there is, in units of the program: infinity would not do, which WGSL need not have.
const FARTHEST: f32 = 1.0e12;

/// One step of a [`ShapeProgram`], `ShapeNode` in `shaders/shape.wgsl`: a primitive, whose distance goes onto the stack, or an
/// operation, which replaces the two topmost distances by one.
///
/// ```
/// use visfield::shape::{Shape, ShapeNode, ShapeProgram};
/// let program = ShapeProgram::new(&Shape::Sphere { radius: 3.0 }, 2.0)?;
/// let [node] = program.nodes() else { unreachable!() };
/// assert_eq!((node.kind, node.parameters[0]), (ShapeNode::SPHERE, 1.5));
/// assert_eq!(size_of::<ShapeNode>(), 64);
/// # Ok::<(), visfield::shape::ShapeError>(())
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ShapeNode {
    /// Which primitive or operation: a constant of this type.
    pub kind: u32,
    /// The primitive's lengths in the order of [`Shape`]'s fields, or the width of a smooth union, in units of the program;
    /// what is left over is 0.
    pub parameters: [f32; 3],
    /// Rows of the isometry from the program's space to the primitive's; 0 for operations.
    pub rows: [[f32; 4]; 3],
}

impl ShapeNode {
    /// [`Shape::Sphere`]
    pub const SPHERE: u32 = 0;
    /// [`Shape::Box`]
    pub const BOX: u32 = 1;
    /// [`Shape::HalfSpace`]
    pub const HALF_SPACE: u32 = 2;
    /// [`Shape::Capsule`]
    pub const CAPSULE: u32 = 3;
    /// [`Shape::Cylinder`]
    pub const CYLINDER: u32 = 4;
    /// [`Shape::Torus`]
    pub const TORUS: u32 = 5;
    /// [`Shape::Cone`]
    pub const CONE: u32 = 6;
    /// [`Shape::Union`] of two; this and higher kinds are operations.
    pub const UNION: u32 = 7;
    /// [`Shape::Intersection`] of two
    pub const INTERSECTION: u32 = 8;
    /// [`Shape::Difference`], with what is removed on top of the stack
    pub const DIFFERENCE: u32 = 9;
    /// [`Shape::SmoothUnion`] of two
    pub const SMOOTH_UNION: u32 = 10;

    fn operation(kind: u32) -> Self {
        Self { kind, ..Self::zeroed() }
    }
}

/// What is evaluated of a [`Shape`]: its nodes in postfix order, of 64 bytes each, on a stack of [`MAX_STACK`] distances.
/// Moves and scales are part of the primitives' nodes (2012, §3.3, eq. 3.7 and 3.10: a scaled primitive is one with scaled
/// lengths, which saves the factor). The default one is of nothing.
///
/// ```
/// use glam::Vec3;
/// use visfield::shape::{Shape, ShapeProgram};
/// let ball = Shape::Sphere { radius: 1.0 }.scaled(2.0).moved(Vec3::X);
/// let program = ShapeProgram::new(&ball, 1.0)?;
/// assert_eq!(program.nodes().len(), 1);
/// assert_eq!(program.distance(Vec3::new(6.0, 0.0, 0.0)), 3.0);
/// // In a space whose unit is half of that, everything is twice as long.
/// let program = ShapeProgram::new(&ball, 0.5)?;
/// assert_eq!(program.distance(Vec3::new(12.0, 0.0, 0.0)), 6.0);
/// # Ok::<(), visfield::shape::ShapeError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapeProgram {
    nodes: Vec<ShapeNode>,
}

impl ShapeProgram {
    /// Flattens a shape. The program's space has `unit`, a length of the shape's space above 0, as its 1.
    ///
    /// # Errors
    /// What [`Shape::validate`] finds, and lengths that are too large once divided by `unit`.
    pub fn new(shape: &Shape, unit: f32) -> Result<Self, ShapeError> {
        if !(unit.is_finite() && unit > 0.0) {
            return Err(ShapeError::Unit(unit));
        }
        let mut program = Self::default();
        let depth = program.add(shape, &Pose::in_units_of(unit), 0)?;
        if depth > MAX_STACK { Err(ShapeError::TooDeep) } else { Ok(program) }
    }

    /// Signed distance from a position, both in units of the program: above 0 outside, below 0 inside, and never larger than
    /// the true distance to the surface. Exact outside of primitives, of what is moved and scaled of them, and of their unions.
    /// Of nothing, and of anything farther away than that, 10¹². Positions that are not finite give no useful answer.
    pub fn distance(&self, position: Vec3) -> f32 {
        shape_distance(&self.nodes, position)
    }

    /// The nodes, as the shaders read them; none if there is nothing.
    pub fn nodes(&self) -> &[ShapeNode] {
        &self.nodes
    }

    /// Appends the nodes of a shape, and tells how many distances its evaluation keeps at once: 0 if it is nothing, and has no
    /// nodes.
    fn add(&mut self, shape: &Shape, pose: &Pose, nesting: usize) -> Result<usize, ShapeError> {
        if nesting > MAX_NESTING {
            return Err(ShapeError::TooDeep);
        }
        match shape {
            Shape::Sphere { radius } => self.primitive(ShapeNode::SPHERE, [("radius", *radius)], pose),
            Shape::Box { half_extents } => {
                self.primitive(ShapeNode::BOX, half_extents.map(|half| ("half_extents", half)), pose)
            }
            Shape::HalfSpace => self.primitive(ShapeNode::HALF_SPACE, [], pose),
            Shape::Capsule { half_length, radius } => {
                self.primitive(ShapeNode::CAPSULE, [("half_length", *half_length), ("radius", *radius)], pose)
            }
            Shape::Cylinder { half_height, radius } => {
                self.primitive(ShapeNode::CYLINDER, [("half_height", *half_height), ("radius", *radius)], pose)
            }
            Shape::Torus { major_radius, minor_radius } => {
                let lengths = [("major_radius", *major_radius), ("minor_radius", *minor_radius)];
                self.primitive(ShapeNode::TORUS, lengths, pose)
            }
            Shape::Cone { height, radius } => {
                self.primitive(ShapeNode::CONE, [("height", *height), ("radius", *radius)], pose)
            }
            Shape::Moved { shape, rotation, translation } => {
                let length_squared: f64 = rotation.iter().map(|x| f64::from(*x) * f64::from(*x)).sum();
                // NaN is not within.
                let is_unit = (length_squared - 1.0).abs() <= UNIT_TOLERANCE;
                if !is_unit {
                    return Err(ShapeError::Rotation(*rotation));
                }
                if !translation.iter().all(|x| x.is_finite()) {
                    return Err(ShapeError::Translation(*translation));
                }
                self.add(shape, &pose.moved(*rotation, *translation), nesting + 1)
            }
            Shape::Scaled { shape, factor } => {
                if !(factor.is_finite() && *factor > 0.0) {
                    return Err(ShapeError::Factor(*factor));
                }
                self.add(shape, &pose.scaled(*factor), nesting + 1)
            }
            Shape::Union(shapes) => self.chain(shapes, ShapeNode::operation(ShapeNode::UNION), pose, nesting),
            Shape::SmoothUnion { shapes, width } => {
                let width = length("width", *width, pose)?;
                // A division by less than the least normal number is one by 0, on GPUs.
                let mut joint = ShapeNode::operation(ShapeNode::UNION);
                if width.is_normal() {
                    joint.kind = ShapeNode::SMOOTH_UNION;
                    joint.parameters[0] = width;
                }
                self.chain(shapes, joint, pose, nesting)
            }
            Shape::Intersection(shapes) if shapes.is_empty() => Err(ShapeError::EmptyIntersection),
            Shape::Intersection(shapes) => {
                self.chain(shapes, ShapeNode::operation(ShapeNode::INTERSECTION), pose, nesting)
            }
            Shape::Difference { shape, removed } => {
                let start = self.nodes.len();
                let first = self.add(shape, pose, nesting + 1)?;
                let second = self.add(removed, pose, nesting + 1)?;
                if first == 0 {
                    self.nodes.truncate(start);
                    return Ok(0);
                }
                if second == 0 {
                    return Ok(first);
                }
                self.push(ShapeNode::operation(ShapeNode::DIFFERENCE))?;
                Ok(first.max(1 + second))
            }
        }
    }

    /// Joins shapes one after the other, so that however many there are, only one distance waits. What is nothing is left out
    /// of unions, and makes an intersection nothing.
    fn chain(&mut self, shapes: &[Shape], joint: ShapeNode, pose: &Pose, nesting: usize) -> Result<usize, ShapeError> {
        let start = self.nodes.len();
        let (mut depth, mut nothing) = (0, false);
        for shape in shapes {
            let own = self.add(shape, pose, nesting + 1)?;
            if own == 0 {
                nothing = true;
            } else if depth == 0 {
                depth = own;
            } else {
                depth = depth.max(1 + own);
                self.push(joint)?;
            }
        }
        if nothing && joint.kind == ShapeNode::INTERSECTION {
            self.nodes.truncate(start);
            return Ok(0);
        }
        Ok(depth)
    }

    fn primitive<const N: usize>(
        &mut self,
        kind: u32,
        lengths: [(&'static str, f32); N],
        pose: &Pose,
    ) -> Result<usize, ShapeError> {
        let mut node = ShapeNode::operation(kind);
        for (parameter, (name, value)) in node.parameters.iter_mut().zip(lengths) {
            *parameter = length(name, value, pose)?;
        }
        let distance = pose.translation.length();
        // NaN is too far as well.
        let near = distance <= MAX_LENGTH;
        if !near {
            return Err(ShapeError::TooLarge { name: "translation", value: distance });
        }
        // The inverse of a rotation is its transpose.
        let axes = pose.axes();
        node.rows = [axes.x_axis, axes.y_axis, axes.z_axis]
            .map(|axis| axis.extend(-axis.dot(pose.translation)).as_vec4().to_array());
        self.push(node)?;
        Ok(1)
    }

    fn push(&mut self, node: ShapeNode) -> Result<(), ShapeError> {
        if self.nodes.len() == MAX_NODES {
            return Err(ShapeError::TooManyNodes);
        }
        self.nodes.push(node);
        Ok(())
    }
}

/// By how much the square of a unit quaternion's length may differ from 1: enough for four digits written by hand.
const UNIT_TOLERANCE: f64 = 1.0e-3;

/// A checked length of a part, in units of the whole.
fn length(name: &'static str, value: f32, pose: &Pose) -> Result<f32, ShapeError> {
    if !(value.is_finite() && value >= 0.0) {
        return Err(ShapeError::Length { name, value });
    }
    let scaled = f64::from(value) * pose.scale;
    // Factors without end make NaN of 0.
    let small = scaled <= MAX_LENGTH;
    if small { Ok(scaled as f32) } else { Err(ShapeError::TooLarge { name, value: scaled }) }
}

/// Evaluates the nodes of a program.
fn shape_distance(nodes: &[ShapeNode], position: Vec3) -> f32 {
    if nodes.is_empty() {
        return FARTHEST;
    }
    let mut stack = [0.0; MAX_STACK];
    let mut height = 0;
    for node in nodes {
        if node.kind < ShapeNode::UNION {
            let [x, y, z] =
                node.rows.map(|[x, y, z, offset]| x * position.x + y * position.y + z * position.z + offset);
            stack[height] = primitive_distance(node.kind, node.parameters, vec3(x, y, z));
            height += 1;
        } else {
            height -= 1;
            stack[height - 1] = joint_distance(node.kind, stack[height - 1], stack[height], node.parameters[0]);
        }
    }
    stack[0].clamp(-FARTHEST, FARTHEST)
}

fn primitive_distance(kind: u32, parameters: [f32; 3], position: Vec3) -> f32 {
    let [a, b, _] = parameters;
    match kind {
        ShapeNode::SPHERE => sphere_distance(position, a),
        ShapeNode::BOX => box_distance(position, parameters.into()),
        ShapeNode::HALF_SPACE => half_space_distance(position),
        ShapeNode::CAPSULE => capsule_distance(position, a, b),
        ShapeNode::CYLINDER => cylinder_distance(position, a, b),
        ShapeNode::TORUS => torus_distance(position, a, b),
        _ => cone_distance(position, a, b),
    }
}

fn joint_distance(kind: u32, a: f32, b: f32, width: f32) -> f32 {
    match kind {
        ShapeNode::UNION => union_distance(a, b),
        ShapeNode::INTERSECTION => intersection_distance(a, b),
        ShapeNode::DIFFERENCE => difference_distance(a, b),
        _ => smooth_union_distance(a, b, width),
    }
}

#[cfg(test)]
mod tests {
    use super::ShapeNode as N;
    use super::*;

    #[test]
    fn shaders_use_the_same_numbers() {
        let source = include_str!("../shaders/shape.wgsl");
        for (name, value) in [
            ("SPHERE", ShapeNode::SPHERE),
            ("BOX", ShapeNode::BOX),
            ("HALF_SPACE", ShapeNode::HALF_SPACE),
            ("CAPSULE", ShapeNode::CAPSULE),
            ("CYLINDER", ShapeNode::CYLINDER),
            ("TORUS", ShapeNode::TORUS),
            ("CONE", ShapeNode::CONE),
            ("UNION", ShapeNode::UNION),
            ("INTERSECTION", ShapeNode::INTERSECTION),
            ("DIFFERENCE", ShapeNode::DIFFERENCE),
            ("SMOOTH_UNION", ShapeNode::SMOOTH_UNION),
            ("NODE_WORDS", (size_of::<ShapeNode>() / 4) as u32),
            ("STACK", MAX_STACK as u32),
        ] {
            let line = format!("const SHAPE_{name}: u32 = {value}u;");
            assert!(source.contains(&line), "{line}");
        }
        assert!(source.contains("const SHAPE_FARTHEST: f32 = 1.0e12;") && FARTHEST == 1.0e12);
    }

    #[test]
    fn moves_and_scales_have_no_nodes_and_joints_follow_what_they_join() {
        let kinds = |shape: &Shape| {
            ShapeProgram::new(shape, 1.0).unwrap().nodes().iter().map(|node| node.kind).collect::<Vec<_>>()
        };
        let (ball, cube) = (Shape::Sphere { radius: 1.0 }, Shape::Box { half_extents: [1.0; 3] });
        let pair = ball.clone().moved(Vec3::X).scaled(2.0).union(cube.clone().scaled(0.5));
        let shape = pair.clone().union(Shape::HalfSpace).difference(cube.clone());
        assert_eq!(kinds(&shape), [N::SPHERE, N::BOX, N::UNION, N::HALF_SPACE, N::UNION, N::BOX, N::DIFFERENCE]);
        let nothing = || Shape::Union(vec![]);
        assert_eq!(ShapeProgram::new(&nothing(), 1.0), Ok(ShapeProgram::default()));
        assert_eq!(kinds(&nothing().union(ball.clone()).union(nothing())), [N::SPHERE]);
        assert_eq!(kinds(&pair.clone().intersection(nothing()).union(cube.clone())), [N::BOX]);
        assert_eq!(kinds(&pair.clone().difference(nothing().moved(Vec3::X))), [N::SPHERE, N::BOX, N::UNION]);
        assert!(kinds(&nothing().difference(pair)).is_empty());
        assert_eq!(kinds(&ball.clone().smooth_union(cube.clone(), 0.1)), [N::SPHERE, N::BOX, N::SMOOTH_UNION]);
        assert_eq!(kinds(&ball.smooth_union(cube, 1.0e-40)), [N::SPHERE, N::BOX, N::UNION]);
    }
}
