// Draws an implicit surface within its box: three shaders by definitions of their own. In the prepass, what a pixel's ray hits, found by
// tracing. In the main pass, the same surface, found from the prepass where there is one. With `IMPLICIT_EDGES`, in the transparent
// phase, the pixels that the surface covers only partly.

#import bevy_pbr::{
    mesh_bindings::mesh,
    mesh_functions,
    mesh_view_bindings::view,
}
#ifdef PREPASS_PIPELINE
#ifdef MOTION_VECTOR_PREPASS
#import bevy_pbr::pbr_prepass_functions::calculate_motion_vector
#endif
#else
#import bevy_pbr::{
    forward_io::VertexOutput,
    pbr_fragment::pbr_input_from_standard_material,
    pbr_functions::{apply_pbr_lighting, main_pass_post_lighting_processing},
    pbr_types::{PbrInput, STANDARD_MATERIAL_FLAGS_UNLIT_BIT},
    prepass_utils,
}
#ifdef STANDARD_MATERIAL_SPECULAR_TRANSMISSION
#import bevy_pbr::{
    mesh_view_bindings::view_transmission_texture,
    pbr_functions,
    pbr_types::{STANDARD_MATERIAL_FLAGS_ATTENUATION_ENABLED_BIT, StandardMaterial},
    transmission,
}
#endif
#endif

struct Surface {
    // Of the box around the surface, in the space of the mesh.
    center: vec3<f32>,
    // Lengths of the distances' space to one of the mesh's.
    units: f32,
    half_extents: vec3<f32>,
    // 1 if it is known to be.
    convex: u32,
    // The box's centre in the space of the distances.
    distance_center: vec3<f32>,
    padding: u32,
    distances: DistanceSource,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(100) var<uniform> surface: Surface;
// The codes or nodes of the distances.
@group(#{MATERIAL_BIND_GROUP}) @binding(101) var<storage, read> pool: array<u32>;

// What follows is plain WGSL.
//#include

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) instance: u32,
}

fn is_orthographic() -> bool {
    return view.clip_from_view[3].w == 1.0;
}

fn local_from_world(instance: u32) -> mat3x3<f32> {
    let inverse = mesh_functions::get_local_from_world(instance);
    return mat3x3(inverse[0].xyz, inverse[1].xyz, inverse[2].xyz);
}

fn world_translation(instance: u32) -> vec3<f32> {
    return mesh_functions::get_world_from_local(instance)[3].xyz;
}

// Half the box, grown by two pixels so that edges that touch it have room.
fn grown_half_extents(instance: u32) -> vec3<f32> {
    let world_from_local = mesh_functions::get_world_from_local(instance);
    let clip_w = transpose(view.clip_from_world)[3];
    let center = world_from_local * vec4(surface.center, 1.0);
    let extent_w = abs((clip_w * world_from_local).xyz) * surface.half_extents;
    let w = abs(dot(clip_w, center)) + extent_w.x + extent_w.y + extent_w.z;
    let pixel = 2.0 * w / abs(view.clip_from_view[1].y * view.viewport.w);
    let rows = transpose(local_from_world(instance));
    return surface.half_extents + 2.0 * pixel * vec3(length(rows[0]), length(rows[1]), length(rows[2]));
}

// The faces of the box that look away from the eye, so that it may be inside. Which they are is decided here and not by their winding:
// that depends on mirrored transforms and cameras. Their depth is of no account, so no plane cuts them but that of the eye.
@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Corner {
    let corner = index - mesh[instance].first_vertex_index;
    let face = corner / 4u;
    let axis = face / 2u;
    let side = select(-1.0, 1.0, face % 2u == 1u);
    let half_extents = grown_half_extents(instance);
    let inverse = local_from_world(instance);
    let eye = inverse * (view.world_position - world_translation(instance)) - surface.center;
    let forward = inverse * -view.world_from_view[2].xyz;
    let faces_eye = select(side * eye[axis] > half_extents[axis], side * forward[axis] < 0.0, is_orthographic());
    var out: Corner;
    out.instance = instance;
    if faces_eye {
        out.position = vec4(0.0, 0.0, 0.0, 1.0);
        return out;
    }
    let turn = corner % 4u;
    let square = vec2(select(-1.0, 1.0, turn == 1u || turn == 2u), select(-1.0, 1.0, turn >= 2u));
    var local = vec3<f32>();
    local[axis] = side;
    local[(axis + 1u) % 3u] = square.x;
    local[(axis + 2u) % 3u] = square.y;
    let world = mesh_functions::get_world_from_local(instance) * vec4(surface.center + local * half_extents, 1.0);
    out.position = view.clip_from_world * world;
    out.position.z = 0.5 * out.position.w;
    return out;
}

// A ray of the view: it starts on the near plane, and its direction has unit length.
struct ViewRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

fn view_ray(pixel: vec2<f32>) -> ViewRay {
    let ndc = (pixel - view.viewport.xy) / view.viewport.zw * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    let near = view.view_from_clip * vec4(ndc, 1.0, 1.0);
    let far = view.view_from_clip * vec4(ndc, 0.0, 1.0);
    let origin = near.xyz / near.w;
    return ViewRay(origin, normalize(far.xyz - origin * far.w));
}

// The radius of a disc as large as a pixel, in widths of it.
const PIXEL_DISC: f32 = 0.5641896;

fn pixel_cone(pixel: vec2<f32>, ray: ViewRay, instance: u32) -> PixelCone {
    let right = view_ray(pixel + vec2(1.0, 0.0));
    let rotation = mat3x3(view.world_from_view[0].xyz, view.world_from_view[1].xyz, view.world_from_view[2].xyz);
    let inverse = local_from_world(instance);
    let local_from_view = inverse * rotation;
    var cone: PixelCone;
    cone.origin = inverse * (view.world_position - world_translation(instance)) + local_from_view * ray.origin;
    cone.direction = local_from_view * ray.direction;
    // Across the ray, the transform may stretch; the larger of two directions.
    let across = normalize(cross(ray.direction, vec3(0.0, 1.0, 0.1)));
    let stretches = vec2(length(local_from_view * across), length(local_from_view * cross(ray.direction, across)));
    let scale = max(stretches.x, stretches.y);
    cone.scale = scale;
    let along = length(cone.direction);
    cone.stretched = max(scale, along) > 1.02 * min(min(stretches.x, stretches.y), along);
    cone.local_from_world = inverse;
    cone.radius = PIXEL_DISC * scale * distance(ray.origin, right.origin);
    cone.growth = PIXEL_DISC * scale * distance(ray.direction, right.direction);
    let half_extents = grown_half_extents(instance);
    let to_center = surface.center - cone.origin;
    // Not zero, so that nothing below is NaN.
    let direction = select(cone.direction, vec3(1.0e-20), abs(cone.direction) < vec3(1.0e-20));
    let one = (to_center - half_extents) / direction;
    let other = (to_center + half_extents) / direction;
    let entry = min(one, other);
    let exit = max(one, other);
    cone.first = max(max(entry.x, entry.y), max(entry.z, 0.0));
    cone.last = min(exit.x, min(exit.y, exit.z));
    // From the space of the mesh to that of the distances.
    cone.origin = surface.distance_center - to_center * surface.units;
    cone.direction *= surface.units;
    cone.radius *= surface.units;
    cone.growth *= surface.units;
    cone.scale *= surface.units;
    cone.local_from_world = surface.units * inverse;
    return cone;
}

// From the space of the distances to the world.
fn world_from_distances(position: vec3<f32>, world_from_local: mat4x4<f32>) -> vec4<f32> {
    let local = surface.center + (position - surface.distance_center) / surface.units;
    return world_from_local * vec4(local, 1.0);
}

fn view_depth(position: vec3<f32>) -> f32 {
    let clip = view.clip_from_view * vec4(position, 1.0);
    return clip.z / clip.w;
}

fn view_to_world(position: vec3<f32>) -> vec4<f32> {
    return view.world_from_view * vec4(position, 1.0);
}

#ifdef PREPASS_PIPELINE

struct PrepassOutput {
    @builtin(frag_depth) depth: f32,
#ifdef NORMAL_PREPASS
    @location(0) normal: vec4<f32>,
#endif
#ifdef MOTION_VECTOR_PREPASS
    @location(1) motion_vector: vec2<f32>,
#endif
}

@fragment
fn fragment(in: Corner) -> PrepassOutput {
    let ray = view_ray(in.position.xy);
    let cone = pixel_cone(in.position.xy, ray, in.instance);
    let meeting = trace_covers(cone);
    if !meeting.hit {
        discard;
    }
    let t = crossing(cone, meeting);
    let local = cone.origin + cone.direction * t;
    let position = ray.origin + ray.direction * t;
    var out: PrepassOutput;
    out.depth = view_depth(position);
#ifdef NORMAL_PREPASS
    let normal = mesh_functions::mesh_normal_local_to_world(cone_gradient(cone, t), in.instance);
    // As in Bevy's own prepass with this plugin's flags.
    out.normal = vec4(normal * 0.5 + vec3(0.5), 1.0 - f32(mesh[in.instance].tag >> 30u) / 3.0);
#endif
#ifdef MOTION_VECTOR_PREPASS
    let previous = world_from_distances(local, mesh_functions::get_previous_world_from_local(in.instance));
    out.motion_vector = calculate_motion_vector(view_to_world(position), previous);
#endif
    return out;
}

#else

struct MainOutput {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

#ifdef STANDARD_MATERIAL_SPECULAR_TRANSMISSION
//#glass
#endif

// What Bevy's lighting makes of a point of the surface, at a place of the pixel's ray. Occlusion is read at `pixel`.
fn lit(
    cone: PixelCone,
    t: f32,
    pixel: vec2<f32>,
    position: vec4<f32>,
    normal: vec3<f32>,
    depth: f32,
    instance: u32,
) -> vec4<f32> {
    var vertex: VertexOutput;
    vertex.position = vec4(pixel, depth, 1.0);
    vertex.world_position = position;
    vertex.world_normal = normal;
#ifdef VERTEX_OUTPUT_INSTANCE_INDEX
    vertex.instance_index = instance;
#endif
    var input = pbr_input_from_standard_material(vertex, true);
    // Not the coarser one of the prepass.
    input.world_normal = normal;
    input.N = normal;
#ifdef STANDARD_MATERIAL_SPECULAR_TRANSMISSION
    let glass = input.material;
    // What goes through is not for Bevy to find, nor scattered back.
    input.material.base_color *= vec4(vec3(1.0 - glass.specular_transmission), 1.0);
    input.material.specular_transmission = 0.0;
#endif
    var color = input.material.base_color;
    if (input.material.flags & STANDARD_MATERIAL_FLAGS_UNLIT_BIT) == 0u {
        color = apply_pbr_lighting(input);
    }
#ifdef STANDARD_MATERIAL_SPECULAR_TRANSMISSION
    let local = cone.origin + cone.direction * t;
    let width = gradient_width(cone, t);
    color += vec4(glass_light(cone, width, local, pixel, position.xyz, normal, depth, glass, instance), 0.0);
#endif
    return vec4(main_pass_post_lighting_processing(input, color).rgb, 1.0);
}

#ifdef IMPLICIT_READS_PREPASS
// Where the prepass found something along a pixel's ray, in world units from the near plane; very far if it found nothing.
fn prepass_t(pixel: vec2<f32>, ray: ViewRay) -> f32 {
    let depth = prepass_utils::prepass_depth(vec4(pixel, 0.0, 1.0), 0u);
    let ndc = (pixel - view.viewport.xy) / view.viewport.zw * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    let found = view.view_from_clip * vec4(ndc, depth, 1.0);
    if found.w == 0.0 {
        return 1.0e30;
    }
    return dot(found.xyz / found.w - ray.origin, ray.direction);
}
#endif

#ifdef IMPLICIT_EDGES

// What a partly covered pixel is to be lit like.
struct Covered {
    pixel: vec2<f32>,
    normal: vec3<f32>,
}

// Occlusion of a partly covered pixel is that of what lies behind it, and around a sharp edge its normal is that of neither side. The
// nearest pixel inwards that the surface covers knows better.
fn covered_pixel(pixel: vec2<f32>, normal: vec3<f32>, instance: u32) -> Covered {
#ifdef IMPLICIT_READS_PREPASS
    let view_normal = (view.view_from_world * vec4(normal, 0.0)).xyz;
    let inwards = normalize(vec2(-view_normal.x, view_normal.y) + vec2(1.0e-9, 0.0));
    for (var steps = 1.0; steps < 2.6; steps += 0.5) {
        let there = floor(pixel + inwards * steps) + vec2(0.5);
        let ray = view_ray(there);
        let cone = pixel_cone(there, ray, instance);
        let t = prepass_t(there, ray);
        if t < 1.0e29 && abs(distance_at(cone, t)) < 1.5 * cone_radius(cone, t) {
            return Covered(there, mesh_functions::mesh_normal_local_to_world(cone_gradient(cone, t), instance));
        }
    }
#endif
    return Covered(pixel, normal);
}

@fragment
fn fragment(in: Corner) -> MainOutput {
    let pixel = in.position.xy;
    let ray = view_ray(pixel);
    var cone = pixel_cone(pixel, ray, in.instance);
#ifdef IMPLICIT_READS_PREPASS
    // What lies behind is hidden.
    cone.last = min(cone.last, prepass_t(pixel, ray));
#endif
    let meeting = trace_covers(cone);
    var color = vec3(0.0);
    var alpha = 0.0;
    var depth = 0.0;
    for (var i = 0u; i < meeting.brushes; i++) {
        var brush = meeting.first;
        if i == 1u {
            brush = meeting.second;
        }
        let gradient = cone_gradient(cone, brush.t);
        var height = brush.height;
        if !cone.stretched {
            // Distances may be bounds that grow more slowly.
            height /= clamp(length(gradient), 0.1, 1.0);
        }
        let coverage = disc_coverage(height);
        if coverage < 1.0 / 255.0 {
            continue;
        }
        let position = ray.origin + ray.direction * brush.t;
        let normal = mesh_functions::mesh_normal_local_to_world(gradient, in.instance);
        let brush_depth = view_depth(position);
        let world = view_to_world(position);
        let like = covered_pixel(pixel, normal, in.instance);
        let shade = lit(cone, brush.t, like.pixel, world, like.normal, brush_depth, in.instance);
        if alpha == 0.0 {
            depth = brush_depth;
        }
        color += (1.0 - alpha) * coverage * shade.rgb;
        alpha += (1.0 - alpha) * coverage;
    }
    if alpha == 0.0 {
        discard;
    }
    return MainOutput(vec4(color / alpha, alpha), depth);
}

#else

@fragment
fn fragment(in: Corner) -> MainOutput {
    let pixel = in.position.xy;
    let ray = view_ray(pixel);
    let cone = pixel_cone(pixel, ray, in.instance);
#ifdef IMPLICIT_READS_PREPASS
    // The prepass has traced this ray. Is what it found this surface?
    let t = prepass_t(pixel, ray);
    if t < cone.first || t > cone.last {
        discard;
    }
    if abs(distance_at(cone, t)) > 0.5 * cone_radius(cone, t) {
        discard;
    }
    let depth = prepass_utils::prepass_depth(in.position, 0u);
#else
    let meeting = trace_covers(cone);
    if !meeting.hit {
        discard;
    }
    let t = crossing(cone, meeting);
    // A little nearer than in a prepass, which may have rounded otherwise.
    let depth = view_depth(ray.origin + ray.direction * t) * (1.0 + 1.0e-6);
#endif
    let gradient = cone_gradient(cone, t);
    let normal = mesh_functions::mesh_normal_local_to_world(gradient, in.instance);
#ifdef IMPLICIT_READS_PREPASS
#ifdef NORMAL_PREPASS
    if dot(normal, prepass_utils::prepass_normal(in.position, 0u)) < 0.95 {
        discard;
    }
#endif
#endif
    let world = view_to_world(ray.origin + ray.direction * t);
    return MainOutput(lit(cone, t, pixel, world, normal, depth, in.instance), depth);
}

#endif
#endif
