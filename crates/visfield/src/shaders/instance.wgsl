// Occluders, and what more than one pass asks of them. Twins: estimate/{mod,source}.rs, estimate/frame/trace.rs and
// field/cap_grid/mod.rs. Joined after frame.wgsl and light.wgsl.

// Which part of a field is asked (layout::source_number).
const SOURCE_NONE: u32 = 0u;
const SOURCE_RAYS: u32 = 1u;
const SOURCE_CAP_GRID: u32 = 2u;
const SOURCE_CAP_GRID_WITH_RAYS_INSIDE: u32 = 3u;
const SOURCE_CONES: u32 = 4u;
const SOURCE_CAP_GRID_WITH_CONES_INSIDE: u32 = 5u;
// In the place of where distances start.
const NO_DISTANCE: u32 = 0xffffffffu;

// Layout: gpu/layout.rs, `InstanceData`.
struct Instance {
    // Rows of the affine map from the camera-relative world to field space.
    field_from_world: array<vec4<f32>, 3>,
    // Rows of the affine map from the camera-relative world to the space of the cap grid.
    cap_from_world: array<vec4<f32>, 3>,
    // Rows of the affine map from the camera-relative world to the space of the distances.
    distance_from_world: array<vec4<f32>, 3>,
    center: vec3<f32>,
    radius: f32,
    // The table; without one `entries` is 0.
    first_byte: u32,
    entries: u32,
    exits: u32,
    encoding: u32,
    // The number of its cap grid.
    cap_grid: u32,
    ambient_source: u32,
    // 0: evenly scaled, 1: its caps are mapped.
    stretched: f32,
    // Of lights as large as cap grids can hide.
    light_source: u32,
    // NO_SHADOWS, NO_OWN_SURFACE
    flags: u32,
    // Of smaller lights.
    small_light_source: u32,
    // Word of the pool at which its distances start.
    distance: u32,
    padding: u32,
}

// It casts no shadows.
const NO_SHADOWS: u32 = 1u;
// It does not occlude its own surface.
const NO_OWN_SURFACE: u32 = 2u;

@group(0) @binding(3) var<storage, read> pool: array<u32>;
@group(0) @binding(4) var<storage, read> instances: array<Instance>;

fn transform(rows: array<vec4<f32>, 3>, v: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v));
}

// The linear part of an affine map, scaled to a largest component of 1: products of three components of tiny or huge objects
// would leave the range of f32.
fn scaled_rows(rows: array<vec4<f32>, 3>) -> array<vec3<f32>, 3> {
    let component = max(max(abs(rows[0].xyz), abs(rows[1].xyz)), abs(rows[2].xyz));
    let largest = max(max(component.x, component.y), component.z);
    return array<vec3<f32>, 3>(rows[0].xyz / largest, rows[1].xyz / largest, rows[2].xyz / largest);
}

// The unit normal of a surface with this normal after an affine map: by the cofactors of the linear map, which are its inverse
// transpose up to a factor.
fn mapped_normal(map: array<vec4<f32>, 3>, normal: vec3<f32>) -> vec3<f32> {
    let rows = scaled_rows(map);
    let x = rows[0];
    let y = rows[1];
    let z = rows[2];
    let cofactors = vec3<f32>(dot(cross(y, z), normal), dot(cross(z, x), normal), dot(cross(x, y), normal));
    let orientation = select(1.0, -1.0, dot(x, cross(y, z)) < 0.0);
    let squared = dot(cofactors, cofactors);
    if squared > 0.0 {
        return cofactors / sqrt(squared) * orientation;
    }
    return vec3<f32>(0.0);
}

fn cosine_direction(normal: vec3<f32>, point: vec3<f32>) -> vec3<f32> {
    let direction = normal + point;
    let squared = dot(direction, direction);
    if squared > 1.0e-8 {
        return direction / sqrt(squared);
    }
    return normal;
}

// What a cap grid starts with in the pool. Layout: gpu/layout.rs, `CapGridData`.
struct CapGrid {
    // Twins of AxisWarp, for the three axes.
    knee: vec3<f32>,
    points: u32,
    slope: vec3<f32>,
    // 0: bytes, 1: halves.
    encoding: u32,
    inverse_slope: vec3<f32>,
    // First word of its points.
    first_texel: u32,
    curvature: vec3<f32>,
    // Words from the points of four coefficients to those of the next four.
    plane_words: u32,
    inverse_extent: vec3<f32>,
    padding: u32,
    half_extents: vec3<f32>,
    padding_2: u32,
    // What 0 and a step of the first four coefficients stand for.
    low: vec4<f32>,
    step: vec4<f32>,
}

// Grids by their number: the pool, seen as headers of grids.
@group(0) @binding(5) var<storage, read> cap_grids: array<CapGrid>;

const INSIDE_MARGIN: f32 = 0.1;
const RAY_BITS: u32 = 5u;

// CapGrid::inside_share
fn inside_share(grid: u32, position: vec3<f32>) -> f32 {
    let beyond = abs(position) - cap_grids[grid].half_extents;
    let largest = max(max(beyond.x, beyond.y), beyond.z);
    return clamp(1.0 - largest * (1.0 / INSIDE_MARGIN), 0.0, 1.0);
}

// Which share of its rays a receiver at a position of the world sends to an instance that is asked so. What is not sent, its
// cap grid or its distances answer, if they are asked at all.
fn share_of_rays(source: u32, instance: u32, position: vec3<f32>) -> f32 {
    switch source {
        case SOURCE_RAYS: { return 1.0; }
        case SOURCE_CAP_GRID_WITH_RAYS_INSIDE: {
            let local = transform(instances[instance].cap_from_world, vec4<f32>(position, 1.0));
            return inside_share(instances[instance].cap_grid, local);
        }
        default: { return 0.0; }
    }
}

// Which share of what a receiver gets comes from cones, likewise.
fn share_of_cones(source: u32, instance: u32, position: vec3<f32>) -> f32 {
    switch source {
        case SOURCE_CONES: { return 1.0; }
        case SOURCE_CAP_GRID_WITH_CONES_INSIDE: {
            let local = transform(instances[instance].cap_from_world, vec4<f32>(position, 1.0));
            return inside_share(instances[instance].cap_grid, local);
        }
        default: { return 0.0; }
    }
}

fn has_caps(source: u32) -> bool {
    return source == SOURCE_CAP_GRID || source == SOURCE_CAP_GRID_WITH_RAYS_INSIDE || source == SOURCE_CAP_GRID_WITH_CONES_INSIDE;
}

fn has_cones(source: u32) -> bool {
    return source == SOURCE_CONES || source == SOURCE_CAP_GRID_WITH_CONES_INSIDE;
}

fn needs_no_rays(source: u32) -> bool {
    return has_caps(source) || has_cones(source);
}

// Whether a ray belongs to the share that is sent.
fn is_sent(ray: u32, residue: u32, share: f32) -> bool {
    let turn = reverseBits((residue << RAY_BITS) | ray) >> 8u;
    return f32(turn) * (1.0 / 16777216.0) < share;
}

// Whether a light is large enough for cap grids.
fn is_large(light: u32) -> bool {
    return ((frame.large_lights >> light) & 1u) != 0u;
}

// Which part of an instance is asked for a light.
fn source_for(instance: u32, light: u32) -> u32 {
    return select(instances[instance].small_light_source, instances[instance].light_source, is_large(light));
}

// Whether an instance can hide any of a light.
fn casts(instance: u32, light: u32) -> bool {
    return source_for(instance, light) != SOURCE_NONE && (instances[instance].flags & NO_SHADOWS) == 0u;
}

// Whether an instance is the receiver's own, as far as is known, and does not occlude it.
fn is_spared(instance: u32, receiver: Receiver) -> bool {
    if (receiver.flags & OWN_SURFACE_OFF) == 0u || (instances[instance].flags & NO_OWN_SURFACE) == 0u {
        return false;
    }
    let origin = transform(instances[instance].field_from_world, vec4<f32>(receiver.position, 1.0));
    return dot(origin, origin) < 1.0;
}

// Whether a sphere can block any ray of the receiver's hemisphere.
fn above_surface(to_center: vec3<f32>, radius: f32, normal: vec3<f32>) -> bool {
    return dot(to_center, normal) > -radius;
}

const CUTOFF: f32 = 1.0 / 2040.0;

// Whether a sphere is near enough, and large enough for its distance, to occlude ambient light.
fn within_reach(to_center: vec3<f32>, radius: f32) -> bool {
    let squared = dot(to_center, to_center);
    return sqrt(squared) - radius < frame.max_distance && radius * radius > CUTOFF * squared;
}
