// Occluders, and what any pass asks of them. Twin: scene.rs. Joined after frame.wgsl.

// Which part of a field answers ambient occlusion (layout::ambient_source_number).
const AMBIENT_RAYS: u32 = 1u;
const AMBIENT_CAP_GRID: u32 = 2u;
const AMBIENT_CAP_GRID_WITH_RAYS_INSIDE: u32 = 3u;

// Layout: gpu/layout.rs, `InstanceData`.
struct Instance {
    // Rows of the affine map from the camera-relative world to field space.
    field_from_world: array<vec4<f32>, 3>,
    // Rows of the affine map from the camera-relative world to the space of the cap grid.
    cap_from_world: array<vec4<f32>, 3>,
    center: vec3<f32>,
    radius: f32,
    // The table; without one `entries` is 0.
    first_byte: u32,
    entries: u32,
    exits: u32,
    encoding: u32,
    // Where the cap grid starts in `tables`.
    cap_first_word: u32,
    ambient_source: u32,
    // 0: evenly scaled, 1: looked at along a few directions.
    stretched: f32,
    padding: u32,
}

@group(0) @binding(3) var<storage, read> tables: array<u32>;
@group(0) @binding(4) var<storage, read> instances: array<Instance>;

fn transform(rows: array<vec4<f32>, 3>, v: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v));
}

// The normal in field space of a surface with this normal in the world: by the cofactors of the linear map, which are its
// inverse transpose up to a factor.
fn field_normal(instance: Instance, normal: vec3<f32>) -> vec3<f32> {
    let rows = instance.field_from_world;
    // Products of three components of tiny or huge objects would leave the range of f32.
    let component = max(max(abs(rows[0].xyz), abs(rows[1].xyz)), abs(rows[2].xyz));
    let largest = max(max(component.x, component.y), component.z);
    let x = rows[0].xyz / largest;
    let y = rows[1].xyz / largest;
    let z = rows[2].xyz / largest;
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

// Half the sides of the mesh's box follow its warps.
const CAP_HALF_EXTENTS: u32 = 17u;

fn cap_number(instance: Instance, index: u32) -> f32 {
    return bitcast<f32>(tables[instance.cap_first_word + index]);
}

// Whether a position in cap space lies inside the mesh's bounding box.
fn contains(instance: Instance, position: vec3<f32>) -> bool {
    let x = abs(position.x) <= cap_number(instance, CAP_HALF_EXTENTS);
    let y = abs(position.y) <= cap_number(instance, CAP_HALF_EXTENTS + 1u);
    return x && y && abs(position.z) <= cap_number(instance, CAP_HALF_EXTENTS + 2u);
}

// Whether rays are sent for ambient occlusion, to a receiver at a position of the world.
fn has_rays(instance: Instance, position: vec3<f32>) -> bool {
    switch instance.ambient_source {
        case AMBIENT_RAYS: { return true; }
        case AMBIENT_CAP_GRID_WITH_RAYS_INSIDE: {
            return contains(instance, transform(instance.cap_from_world, vec4<f32>(position, 1.0)));
        }
        default: { return false; }
    }
}
