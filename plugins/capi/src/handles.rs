//! Handles: numbers that never come again, in the form of pointers that nobody may look through. One that was freed, or was
//! never given, or is of another kind, is found out.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use drapery_shot::fault::{Fault, FaultKind};
use drapery_shot::scene_source::SceneSource;
use drapery_shot::session::SavedState;

use crate::objects::{ErrorParts, Simulation};
use crate::{DRAPERY_DONE, DRAPERY_USAGE};

/// Object behind a handle.
#[derive(Clone)]
pub(crate) enum Object {
    Scene(Arc<Mutex<SceneSource>>),
    Simulation(Arc<Mutex<Simulation>>),
    State(Arc<Mutex<SavedState>>),
    Error(Arc<ErrorParts>),
}

/// All objects that are alive, and the last number that was given.
struct Table {
    last: usize,
    objects: BTreeMap<usize, Object>,
}

static TABLE: Mutex<Table> = Mutex::new(Table { last: 0, objects: BTreeMap::new() });

/// Numbers grow by this, so that a handle looks like the address of something and null is none.
const STRIDE: usize = 16;

fn table() -> MutexGuard<'static, Table> {
    // Every change is complete in itself.
    TABLE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A handle for an object.
pub(crate) fn give<T>(object: Object) -> *mut T {
    let mut table = table();
    table.last += STRIDE;
    let number = table.last;
    table.objects.insert(number, object);
    std::ptr::without_provenance_mut(number)
}

/// A kind of object that has handles.
pub(crate) trait Kind: Sized {
    /// Its name in messages.
    const NAME: &'static str;

    /// The object, if it is of this kind.
    fn of(object: &Object) -> Option<Arc<Mutex<Self>>>;
}

impl Kind for SceneSource {
    const NAME: &'static str = "scene";

    fn of(object: &Object) -> Option<Arc<Mutex<Self>>> {
        if let Object::Scene(scene) = object { Some(scene.clone()) } else { None }
    }
}

impl Kind for Simulation {
    const NAME: &'static str = "simulation";

    fn of(object: &Object) -> Option<Arc<Mutex<Self>>> {
        if let Object::Simulation(simulation) = object { Some(simulation.clone()) } else { None }
    }
}

impl Kind for SavedState {
    const NAME: &'static str = "state";

    fn of(object: &Object) -> Option<Arc<Mutex<Self>>> {
        if let Object::State(state) = object { Some(state.clone()) } else { None }
    }
}

fn unknown(name: &str) -> Fault {
    let what = format!("this is no handle of a {name}, or one that was freed");
    Fault::new(
        FaultKind::Usage,
        format!("{what}\n  help: give what a function of Drapery has given, before it is freed"),
    )
}

/// Does something with the object of a handle. One thread at a time may.
pub(crate) fn with<K: Kind, H, T>(handle: *const H, work: impl FnOnce(&mut K) -> Result<T, Fault>) -> Result<T, Fault> {
    let object = table().objects.get(&handle.addr()).and_then(K::of);
    let object = object.ok_or_else(|| unknown(K::NAME))?;
    let mut held = object.try_lock().map_err(|error| match error {
        TryLockError::WouldBlock => {
            let what = format!("another call uses this {}", K::NAME);
            Fault::new(FaultKind::Usage, format!("{what}\n  help: wait for it to return, in callbacks, too"))
        }
        TryLockError::Poisoned(_) => {
            let what = format!("a bug in Drapery has broken this {}", K::NAME);
            Fault::new(FaultKind::Internal, format!("{what}\n  help: free it, and make another"))
        }
    })?;
    work(&mut held)
}

/// The parts of an error.
pub(crate) fn error<H>(handle: *const H) -> Option<Arc<ErrorParts>> {
    match table().objects.get(&handle.addr()) {
        Some(Object::Error(parts)) => Some(parts.clone()),
        _ => None,
    }
}

impl Object {
    /// Whether a call works with it.
    fn is_used(&self) -> bool {
        match self {
            Self::Scene(scene) => is_locked(scene),
            Self::Simulation(simulation) => is_locked(simulation),
            Self::State(state) => is_locked(state),
            Self::Error(_) => false,
        }
    }
}

fn is_locked<T>(object: &Mutex<T>) -> bool {
    matches!(object.try_lock(), Err(TryLockError::WouldBlock))
}

/// Frees the object of a handle if it is of the kind that `is` looks for and no call uses it, a callback's included, and says whether
/// it did.
pub(crate) fn free<H>(handle: *mut H, is: fn(&Object) -> bool) -> bool {
    let mut table = table();
    let number = handle.addr();
    let freed = if table.objects.get(&number).is_some_and(|object| is(object) && !object.is_used()) {
        table.objects.remove(&number)
    } else {
        None
    };
    // Its memory is given back when others may already use the table.
    drop(table);
    freed.is_some()
}

/// Frees the object of a handle as [`free`] does; the code that C gets.
pub(crate) fn freed<H>(handle: *mut H, is: fn(&Object) -> bool) -> i32 {
    if handle.is_null() || free(handle, is) { DRAPERY_DONE } else { DRAPERY_USAGE }
}
