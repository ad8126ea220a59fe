//! What a stage makes from the model. While the run changes its model, a thread makes the next one and frames go on. The next one
//! takes over with the first frame that has its fingerprint.

use crate::{control::ControlWatch, control::Thresholds, model::PinnedModel};
use anyhow::ensure;
use mluc_ipc_types::{ContractError, FrameHeader};
use mluc_model::Model;
use mluc_runtime::Shell;
use rustix::{process::nice, thread::gettid};
use std::{process::Command, sync::Arc, thread, thread::JoinHandle};

type Make<T> = dyn Fn(&Model) -> anyhow::Result<T> + Send + Sync;

pub(crate) struct Models<T> {
    pub(crate) control: ControlWatch,
    fingerprint: u64,
    pub(crate) made: T,
    make: Arc<Make<T>>,
    next: Option<(PinnedModel, JoinHandle<Option<T>>)>,
}

impl<T: Send + 'static> Models<T> {
    /// `made`: made from the model that the stage begins with. `make`: makes it from a later model.
    pub(crate) fn new(
        shell: &Shell,
        model: &Model,
        made: T,
        make: impl Fn(&Model) -> anyhow::Result<T> + Send + Sync + 'static,
    ) -> Models<T> {
        Models {
            control: ControlWatch::new(shell.instance()),
            fingerprint: model.fingerprint,
            made,
            make: Arc::new(make),
            next: None,
        }
    }

    /// What was made from the frame's model, and the thresholds that the frame is judged by, if a reload changed them. Refuses a
    /// frame of a model that this stage does not have.
    pub(crate) fn of_frame(
        &mut self,
        header: &FrameHeader,
    ) -> Result<(&mut T, Option<Thresholds>), ContractError> {
        let control = self.control.look();
        let thresholds = control.thresholds_of(header);
        let wanted = control.reload.iter().find_map(|r| r.model.as_ref());
        let wanted = wanted.filter(|next| next.fingerprint != self.fingerprint);
        if wanted != self.next.as_ref().map(|(next, _)| next) {
            self.next = wanted.map(|next| (next.clone(), start(next.clone(), self.make.clone())));
        }
        let found = header.model_fingerprint;
        if let Some((_, thread)) = self.next.take_if(|(next, _)| next.fingerprint == found)
            && let Ok(Some(made)) = thread.join()
        {
            self.fingerprint = found;
            let before = std::mem::replace(&mut self.made, made);
            // A thread frees the memory, because a frame has no time for it.
            thread::spawn(move || {
                drop(before);
                give_memory_back();
            });
        }
        header.check_model(self.fingerprint)?;
        Ok((&mut self.made, thresholds))
    }
}

/// Returns freed memory between used blocks to the system. Otherwise glibc keeps it, and each change of the model would leave more of it.
fn give_memory_back() {
    #[cfg(target_env = "gnu")]
    {
        #[allow(unsafe_code)]
        // SAFETY: the declaration is that of malloc.h; any thread may call it at any time (malloc_trim(3)).
        unsafe extern "C" {
            safe fn malloc_trim(keep_bytes: usize) -> std::ffi::c_int;
        }
        malloc_trim(0);
    }
}

/// Makes the next model in a thread. A file named after this process reports to the supervisor: `ready`, or why it cannot be made.
fn start<T: Send + 'static>(next: PinnedModel, make: Arc<Make<T>>) -> JoinHandle<Option<T>> {
    thread::spawn(move || {
        let made = load(&next, &*make);
        let error = made.as_ref().err().map(|error| format!("{error:#}"));
        let report = next.file.with_file_name(std::process::id().to_string());
        // Without this file the supervisor refuses the model after a while.
        let _ = std::fs::write(report, error.as_deref().unwrap_or("ready"));
        made.ok()
    })
}

/// Runs at low priority, so that the threads of the frames go first. Only `chrt` gives a real-time priority and takes it away.
fn load<T: Send>(next: &PinnedModel, make: &Make<T>) -> anyhow::Result<T> {
    let thread = gettid().as_raw_nonzero().to_string();
    let words = ["-o", "-p", "0", &thread];
    let _ = Command::new("chrt").args(words).output();
    let _ = nice(10);
    let model = Model::read(&next.file)?;
    ensure!(model.fingerprint == next.fingerprint, "the copy is damaged");
    // The threads of the common pool compute the frames.
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(|| make(&model))
}
