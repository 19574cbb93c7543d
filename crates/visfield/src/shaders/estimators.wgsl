// The cheap estimators of the 2012 thesis over a distance field, to be compared with. Twin: distance/estimators.rs, same names.
// The including shader declares `DistanceSource` and `fn field_distance(source: DistanceSource, position: vec3<f32>) -> f32`.

struct ShadowMarch {
    start: f32,
    threshold: f32,
    max_steps: u32,
}

struct NormalOcclusion {
    step: f32,
    samples: u32,
    base: f32,
    strength: f32,
    up: vec3<f32>,
    bend: f32,
}

// Algorithm 3.2, as occlusion. Without a penumbra: any distance that is not met is as good as another.
fn hard_shadow(
    source: DistanceSource,
    position: vec3<f32>,
    direction: vec3<f32>,
    t_light: f32,
    march: ShadowMarch,
) -> f32 {
    return penumbra_shadow(source, position, direction, t_light, 1.0e30, march);
}

// Algorithm 3.3, as occlusion.
fn penumbra_shadow(
    source: DistanceSource,
    position: vec3<f32>,
    direction: vec3<f32>,
    t_light: f32,
    scale: f32,
    march: ShadowMarch,
) -> f32 {
    var t = march.start;
    var lit = 1.0;
    for (var i = 0u; i < march.max_steps && t < t_light; i++) {
        let nearest = field_distance(source, position + direction * t);
        if nearest < march.threshold {
            return 1.0;
        }
        lit = min(lit, scale * nearest / t);
        t += nearest;
    }
    return 1.0 - lit;
}

// The part of the way along the normal that is missing (equation 3.31).
fn shortfall(source: DistanceSource, position: vec3<f32>, normal: vec3<f32>, settings: NormalOcclusion) -> f32 {
    var missing = 0.0;
    var most = 0.0;
    var weight = 1.0;
    var direction = normal;
    for (var k = 1u; k <= settings.samples; k++) {
        weight /= settings.base;
        let t = settings.step * f32(k);
        let expected = sqrt(dot(direction, direction)) * t;
        missing += weight * (expected - max(field_distance(source, position + direction * t), 0.0));
        most += weight * expected;
        direction += settings.up * settings.bend;
    }
    return missing / most;
}

// Algorithms 3.4 and, with a bent normal, 3.7.
fn normal_occlusion(
    source: DistanceSource,
    position: vec3<f32>,
    normal: vec3<f32>,
    settings: NormalOcclusion,
) -> f32 {
    return clamp(settings.strength * shortfall(source, position, normal, settings), 0.0, 1.0);
}

// Equation 3.26.
fn evans_occlusion(source: DistanceSource, position: vec3<f32>, normal: vec3<f32>, settings: NormalOcclusion) -> f32 {
    return 1.0 - exp(-settings.strength * max(shortfall(source, position, normal, settings), 0.0));
}
