#[path = "../tests/judge/mod.rs"]
#[allow(dead_code)]
mod judge;
use physinc::event::Kind;
fn main() {
    let scene = physinc::sim::Scene::parse(&std::env::args().nth(1).unwrap()).unwrap();
    let (events, _) = judge::run(&scene, &judge::config(&scene, physinc::config::Method::Best));
    for e in &events {
        match &e.kind {
            Kind::CameraOrientation(o) => println!(
                "{:.3} g {:.3?} sd {:.3} flights {}",
                e.timestamp_ns as f64 * 1e-9,
                o.gravity_in_camera,
                (o.covariance[0][0] + o.covariance[1][1] + o.covariance[2][2]).sqrt(),
                o.flights
            ),
            Kind::TrackStarted(_) => println!("{:.3} track {:?} started", e.timestamp_ns as f64 * 1e-9, e.track),
            Kind::TrackEnded(t) => println!("{:.3} track {:?} ended {:?}", e.timestamp_ns as f64 * 1e-9, e.track, t.reason),
            Kind::Inconsistency(i) => println!(
                "{:.3} track {:?} inconsistent {:.4} > {:.4} at {:.3?}",
                e.timestamp_ns as f64 * 1e-9,
                e.track,
                i.distance,
                i.threshold,
                i.measured
            ),
            Kind::Contact(c) => println!(
                "{:.3} track {:?} contact {} {} t {:.4} at {:.4?} {:.3?} -> {:.3?} surface {:?}",
                e.timestamp_ns as f64 * 1e-9,
                e.track,
                c.id,
                e.is_final,
                c.time_ns as f64 * 1e-9,
                c.center,
                c.velocity_before.unwrap(),
                c.velocity_after.unwrap(),
                c.surface
            ),
            Kind::Position(p) if std::env::var_os("POSITIONS").is_some() => {
                println!("{:.3} track {:?} at {:.4?}  {:?}", e.timestamp_ns as f64 * 1e-9, e.track, p.center, p.points)
            }
            _ => {}
        }
    }
    println!("true g {:?}", scene.truth().gravity_in_camera);
    for c in &scene.truth().contacts {
        println!(
            "true contact ball {} t {:.4} {:.3?} {} edge {}",
            c.ball,
            c.time_ns as f64 * 1e-9,
            c.center_in_camera,
            c.surface,
            c.on_edge
        );
    }
}
