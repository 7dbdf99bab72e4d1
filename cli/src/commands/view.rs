//! `drapery view`: a run in the browser.

use std::io::ErrorKind;
use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use drapery_analysis::view::{self, Answer, ViewError, Viewer};
use drapery_io::error::IoError;
use drapery_shot::farm::lock::{self, Presence};
use drapery_shot::fault::Fault;
use oxhttp::model::header::{CACHE_CONTROL, CONTENT_TYPE, HOST};
use oxhttp::model::{Body, Method, Request, Response, StatusCode};
use oxhttp::{ListeningServer, Server};

use crate::args::ViewArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// The first port that is tried.
const PORT: u16 = 8017;

/// Ports that are tried, for as many runs that are looked at at a time.
const PORTS: u16 = 32;

/// Connections at a time; a browser has six.
const CONNECTIONS: usize = 64;

/// Time that a run is given to appear: a program that has just been launched reads its scene before it writes.
const LAUNCH: Duration = Duration::from_secs(5);

/// Interval between two looks for a run.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// Shows a run, or writes a page of it.
pub(crate) fn view(args: &ViewArgs) -> Result<ExitCode, Failure> {
    if let Some(file) = &args.page {
        return write(&args.folder, file);
    }
    let viewer = Arc::new(launched(&args.folder)?);
    let page: Arc<str> = view::page()?.into();
    let (server, port) = serve(&viewer, &page, args.port)?;
    let address = format!("http://{}:{port}/", Ipv4Addr::LOCALHOST);
    say::line(format_args!("{address} shows {}; Ctrl-C ends it", args.folder.display()));
    let is_open = args.no_browser || has_screen() && open::that_detached(&address).is_ok();
    if !is_open {
        say::line("no browser could be opened here; open the address in one on this machine");
    }
    server
        .join()
        .map_err(|error| Failure::new(ExitCode::Io, format!("the page cannot be served any more: {error}")))?;
    Ok(ExitCode::Done)
}

/// The run of a folder: waits for one that is being launched, as long as it holds the folder.
fn launched(folder: &Path) -> Result<Viewer, ViewError> {
    let mut last_held = Instant::now();
    let mut is_waiting = false;
    loop {
        let error = match Viewer::new(folder) {
            Err(error @ ViewError::Run(IoError::NoRun { .. })) => error,
            other => return other,
        };
        let holder = lock::holder(folder, SystemTime::now())?;
        if holder.is_some_and(|holder| holder.presence == Presence::Alive) {
            last_held = Instant::now();
        }
        if last_held.elapsed() > LAUNCH {
            return Err(error);
        }
        if !std::mem::replace(&mut is_waiting, true) {
            say::line(format_args!("waiting for a run in {}; Ctrl-C ends it", folder.display()));
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

fn write(folder: &Path, file: &Path) -> Result<ExitCode, Failure> {
    let written = view::write_page(folder, file)?;
    let (frames, megabytes) = (written.frames, written.bytes as f64 / 1e6);
    let of =
        if written.of > frames { format!("{frames} of {} frames", written.of) } else { format!("{frames} frames") };
    say::line(format_args!("wrote {}: {of}, {megabytes:.1} MB", file.display()));
    Ok(ExitCode::Done)
}

/// Whether a browser would be seen: without a screen, the desktop's opener may start one in the terminal.
fn has_screen() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(target_os = "linux") || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// Serves on this port, or on the first free one.
fn serve(viewer: &Arc<Viewer>, page: &Arc<str>, asked: Option<u16>) -> Result<(ListeningServer, u16), Failure> {
    let ports = asked.map_or(PORT..=PORT + PORTS - 1, |port| port..=port);
    for port in ports.clone() {
        let (viewer, page) = (Arc::clone(viewer), Arc::clone(page));
        let server = Server::new(move |request| answer(&viewer, &page, port, request));
        let server = server.bind((Ipv4Addr::LOCALHOST, port)).with_max_concurrent_connections(CONNECTIONS);
        match server.spawn() {
            Ok(server) => return Ok((server, port)),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {}
            Err(error) => {
                let text = format!("port {port}: {error}\n  help: give another port with --port");
                return Err(Failure::new(ExitCode::CannotCreate, text));
            }
        }
    }
    let which = match asked {
        Some(port) => format!("port {port} is in use"),
        None => format!("ports {} to {} are in use", ports.start(), ports.end()),
    };
    Err(Failure::new(
        ExitCode::CannotCreate,
        format!("{which}\n  help: give another port with --port, or leave it out"),
    ))
}

fn answer(viewer: &Viewer, page: &str, port: u16, request: &Request<Body>) -> Response<Body> {
    // A page from elsewhere that has its own name lead to this machine could otherwise read the run.
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    if ![format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&host.to_owned()) {
        return response(StatusCode::FORBIDDEN, "text/plain; charset=utf-8", b"only for this machine".to_vec());
    }
    if request.method() != Method::GET {
        return response(StatusCode::METHOD_NOT_ALLOWED, "text/plain; charset=utf-8", b"read only".to_vec());
    }
    match request.uri().path().trim_start_matches('/') {
        "" => response(StatusCode::OK, "text/html; charset=utf-8", page.as_bytes().to_vec()),
        path => match viewer.answer(path) {
            Ok(Answer { kind, bytes }) => response(StatusCode::OK, kind, bytes),
            Err(error) => {
                let status = match error {
                    ViewError::Unknown => StatusCode::NOT_FOUND,
                    _ => StatusCode::SERVICE_UNAVAILABLE,
                };
                response(status, "text/plain; charset=utf-8", say::message(&error.to_string()).into_bytes())
            }
        },
    }
}

fn response(status: StatusCode, kind: &'static str, bytes: Vec<u8>) -> Response<Body> {
    let response = Response::builder().status(status).header(CONTENT_TYPE, kind).header(CACHE_CONTROL, "no-store");
    // Names and values of the headers are constants.
    response.body(Body::from(bytes)).unwrap_or_else(|_| Response::new(Body::empty()))
}

impl From<ViewError> for Failure {
    fn from(error: ViewError) -> Self {
        match error {
            ViewError::Run(error) => error.into(),
            other => {
                let Fault { kind, message, .. } = other.into();
                Self::new(kind.into(), message)
            }
        }
    }
}
