//! GPU against CPU twin: layouts, table indices, whole passes, and the pool.

mod caps;
mod device;
mod distances;
mod frame;
mod layout;
mod lookup;
mod pool;
mod shape;
mod speed;
