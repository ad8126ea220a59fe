//! The topic `status`, as its consumers read it.

use crate::{Input, error::Result, monotonic_ns, node::IpcNode};
use mluc_ipc_types::{Status, Topic};

/// Follows the topic.
pub struct StatusWatch {
    input: Input<Status>,
    last: Option<Status>,
}

impl StatusWatch {
    pub(crate) fn open(node: &IpcNode) -> Result<StatusWatch> {
        Ok(StatusWatch {
            input: Input::open(node, &Topic::STATUS, Topic::STATUS.name, false)?,
            last: None,
        })
    }

    /// The status as of now; `None`: no supervisor has published one yet.
    pub fn update(&mut self) -> Result<Option<Status>> {
        let last = self.last()?;
        Ok(last.map(|status| status.at(monotonic_ns())))
    }

    /// The last status as it was published. A status that breaks the contract is ignored.
    pub fn last(&mut self) -> Result<Option<Status>> {
        if let Some(message) = self.input.newest()?
            && let [status] = message.elements()
            && status.checked().is_ok()
        {
            self.last = Some(*status);
        }
        Ok(self.last)
    }
}
