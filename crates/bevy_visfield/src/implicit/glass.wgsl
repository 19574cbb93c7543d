// Light that comes through a surface of glass: rays are refracted into the solid, followed to where they leave it, and from there
// through the picture of what lies behind.

// Surfaces that a ray meets from within, at most.
const GLASS_BOUNCES: u32 = 6u;
// Of the depth buffer, along a ray.
const GLASS_STEPS: u32 = 32u;
const GLASS_BISECTIONS: u32 = 5u;

struct GlassPath {
    // Where the ray leaves, in the space of the distances.
    position: vec3<f32>,
    // Its direction there in the world, of unit length.
    direction: vec3<f32>,
    // The way in the glass in world units.
    way: f32,
    // The part of the light that is not reflected to elsewhere.
    through: f32,
}

// The part of unpolarized light that a surface of glass reflects, by the cosine on the side of the air (Fresnel).
fn reflected_part(cosine: f32, index: f32) -> f32 {
    let outside = saturate(cosine);
    let inside = sqrt(1.0 - (1.0 - outside * outside) / (index * index));
    let across = (outside - index * inside) / (outside + index * inside);
    let along = (index * outside - inside) / (index * outside + inside);
    return 0.5 * (across * across + along * along);
}

// The way of a ray that meets the surface at a place, with the normal of it in the world.
fn through_glass(
    cone: PixelCone,
    width: f32,
    entry: vec3<f32>,
    entry_normal: vec3<f32>,
    ray: vec3<f32>,
    index: f32,
    instance: u32,
) -> GlassPath {
    let source = surface.distances;
    let settings = SphereTracing(
        RELAXATION, true, MAX_STEPS, source.threshold, 0.0, EXHAUSTED_NEAREST, 3u, true, 0.0, 1.0, 0.0,
    );
    var path = GlassPath(entry, refract(ray, entry_normal, 1.0 / index), 0.0, 1.0);
    path.through -= reflected_part(-dot(ray, entry_normal), index);
    for (var i = 0u; i < GLASS_BOUNCES; i++) {
        // As far beyond the surface as the ray may have ended before it (section 3.3 of the 2014 paper).
        let steepest = gradient(source, path.position, width);
        // On ridges distances have no direction.
        let outwards = select(-path.direction, normalize(steepest), dot(steepest, steepest) > 1.0e-12);
        let start = path.position - outwards * escape(settings, field_distance(source, path.position));
        let along = cone.local_from_world * path.direction;
        let per_unit = length(along);
        let direction = along / per_unit;
        let end = max(box_segment(start, direction, source.low, source.high).y, 0.0);
        var traced: Traced;
        if surface.convex == 1u {
            traced = trace_out_of_convex(source, start, direction, end, settings);
        } else {
            traced = sphere_trace(source, start, direction, 0.0, end, settings);
        }
        let t = clamp(traced.t, 0.0, end);
        path.position = start + direction * t;
        path.way += t / per_unit;
        let normal = mesh_functions::mesh_normal_local_to_world(gradient(source, path.position, width), instance);
        let refracted = refract(path.direction, -normal, index);
        if dot(refracted, refracted) > 0.0 {
            path.direction = refracted;
            path.through *= 1.0 - reflected_part(dot(refracted, normal), index);
            return path;
        }
        // Total reflection.
        path.direction = reflect(path.direction, normal);
    }
    return path;
}

// The place on the screen where a ray that starts behind the surface, whose depth is `front`, meets what the prepass saw; where it
// leaves the screen if it meets nothing. As in normalized device coordinates.
fn seen_along(position: vec3<f32>, direction: vec3<f32>, front: f32) -> vec2<f32> {
    let start = view.clip_from_world * vec4(position, 1.0);
    let along = view.clip_from_world * vec4(direction, 0.0);
    let from_start = start.xyz / start.w;
    // Where it ends: infinitely far, or near the plane of the eye.
    var end = start + along * 1.0e3;
    if along.w > 1.0e-6 {
        end = along;
    } else if along.w < -1.0e-6 {
        end = start + along * (0.95 * start.w / -along.w);
    }
    var way = end.xyz / end.w - from_start;
    // What is beyond the screen's edge is not known.
    let edges = (sign(way.xy) - from_start.xy) / select(way.xy, vec2(1.0e-9), abs(way.xy) < vec2(1.0e-9));
    way *= saturate(min(edges.x, edges.y));
#ifdef DEPTH_PREPASS
    var before = 0.0;
    var after = 0.0;
    for (var i = 0u; i < GLASS_STEPS && after == 0.0; i++) {
        let u = f32(i) / f32(GLASS_STEPS - 1u);
        if hidden(from_start + way * u, front) {
            if i == 0u {
                return from_start.xy;
            }
            after = u;
        } else {
            before = u;
        }
    }
    if after > 0.0 {
        for (var i = 0u; i < GLASS_BISECTIONS; i++) {
            let middle = 0.5 * (before + after);
            if hidden(from_start + way * middle, front) {
                after = middle;
            } else {
                before = middle;
            }
        }
        return from_start.xy + way.xy * after;
    }
    return from_start.xy + way.xy;
#else
    // What is as far behind the surface as it is large.
    let size = length(surface.half_extents);
    let there = start + along * min(4.0 * size, select(1.0e30, 0.9 * start.w / -along.w, along.w < 0.0));
    return there.xy / there.w;
#endif
}

#ifdef DEPTH_PREPASS
// Whether the prepass saw something before a place, and behind a depth.
fn hidden(place: vec3<f32>, front: f32) -> bool {
    let pixel = (saturate(place.xy * vec2(0.5, -0.5) + 0.5)) * (view.viewport.zw - 1.0) + 0.5 + view.viewport.xy;
    let seen = prepass_utils::prepass_depth(vec4(pixel, 0.0, 1.0), 0u);
    return seen > place.z && seen <= front;
}
#endif

// What the picture of everything but glass shows at a place.
fn background(place: vec2<f32>, pixel: vec2<f32>, position: vec3<f32>, roughness: f32) -> vec3<f32> {
    // Not the last texels, beyond which the sampler may not repeat them.
    let inside = clamp(place * vec2(0.5, -0.5) + 0.5, 1.0 / view.viewport.zw, 1.0 - 1.0 / view.viewport.zw);
    let size = vec2<f32>(textureDimensions(view_transmission_texture));
    let at = (inside * view.viewport.zw + view.viewport.xy) / size;
    // At a depth in front of which there is nothing: that has been seen to.
    let fragment = vec3(pixel, 2.0);
    if roughness == 0.0 {
        return transmission::fetch_transmissive_background_non_rough(at, fragment).rgb;
    }
    let view_z = dot(transpose(view.view_from_world)[2], vec4(position, 1.0));
    return transmission::fetch_transmissive_background(at, fragment, view_z, roughness).rgb;
}

// What is seen through the surface, and reflected in it of the picture, where no environment map says more.
fn glass_light(
    cone: PixelCone,
    width: f32,
    entry: vec3<f32>,
    pixel: vec2<f32>,
    position: vec3<f32>,
    normal: vec3<f32>,
    depth: f32,
    material: StandardMaterial,
    instance: u32,
) -> vec3<f32> {
    let to_eye = pbr_functions::calculate_view(vec4(position, 1.0), is_orthographic());
    // Edges are seen from beside.
    let facing = normalize(normal + to_eye * max(0.01 - dot(normal, to_eye), 0.0));
    let path = through_glass(cone, width, entry, facing, -to_eye, max(material.ior, 1.0001), instance);
    let world = world_from_distances(path.position, mesh_functions::get_world_from_local(instance)).xyz;
    let seen = background(seen_along(world, path.direction, depth), pixel, position, material.perceptual_roughness);
    var light = material.specular_transmission * material.base_color.rgb * path.through * seen;
    if (material.flags & STANDARD_MATERIAL_FLAGS_ATTENUATION_ENABLED_BIT) != 0u {
        let left = max(material.attenuation_color.rgb, vec3(1.0e-4));
        light *= pow(left, vec3(path.way / max(material.attenuation_distance, 1.0e-6)));
    }
#ifndef ENVIRONMENT_MAP
    let mirrored = reflect(-to_eye, facing);
    let reflection = background(seen_along(position, mirrored, 2.0), pixel, position, material.perceptual_roughness);
    light += reflected_part(dot(to_eye, facing), max(material.ior, 1.0001)) * reflection;
#endif
    return light;
}
