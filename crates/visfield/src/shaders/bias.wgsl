// How near to the surface that a ray leaves hits do not count. Twin: field/query.rs.

struct Bias {
    height: f32,
    along: f32,
}
