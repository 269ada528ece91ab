//! Warnings that the library logs, for tests. A logger captures the whole process, so other tests in it are heard too.

use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use log::{LevelFilter, Log, Metadata, Record};

static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Held while [`logged_by`] listens.
static LISTENING: Mutex<()> = Mutex::new(());

struct Keeper;

impl Log for Keeper {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn
    }

    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) {
            lock(&WARNINGS).push(record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// The lock, also after a test has failed while it held it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// All warnings since the first call in this process, which installs the logger.
///
/// # Panics
/// If the process has another logger.
pub fn kept() -> Vec<String> {
    static INSTALL: Once = Once::new();
    INSTALL.call_once(|| {
        log::set_logger(&Keeper).expect("no other logger is set in this process");
        log::set_max_level(LevelFilter::Warn);
    });
    lock(&WARNINGS).clone()
}

/// The warnings that are logged while something runs. One call at a time listens.
pub fn logged_by(run: impl FnOnce()) -> Vec<String> {
    let _listening = lock(&LISTENING);
    let before = kept().len();
    run();
    kept().split_off(before)
}
