//! PyTorch's zip archive: `NAME/data.pkl`, and `NAME/data/KEY` for each storage, stored without compression.

use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

use super::{Checkpoint, state};
use crate::exchange::ExchangeError;
use crate::exchange::pickle::{self, PICKLE_BYTES_MAX, Storage};

pub(super) fn read(bytes: &[u8]) -> Result<Checkpoint, ExchangeError> {
    let mut archive = Archive::open(bytes)?;
    let order = archive.find("byteorder", bytes.len())?;
    if order.is_some_and(|order| order != b"little") {
        return Err(record("byteorder", "little", "another"));
    }
    let pickled = archive.take("data.pkl", PICKLE_BYTES_MAX)?;
    let (heap, root, _) = pickle::read(&pickled)?;
    let tensors = state::tensors(&heap, root, bytes.len(), |storage: &Storage| {
        let size = storage.count.checked_mul(storage.element.bytes());
        // A record cannot be longer than the file that holds it.
        let limit = size.unwrap_or(usize::MAX).min(bytes.len());
        archive.take(&format!("data/{}", storage.key), limit)
    })?;
    Ok(Checkpoint {
        tensors,
        manifest: None,
    })
}

struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
    /// The folder that everything lies in, with its slash.
    folder: String,
}

impl Archive<'_> {
    fn open(bytes: &[u8]) -> Result<Archive<'_>, ExchangeError> {
        let zip = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
        let names = zip.file_names().filter_map(Result::ok);
        let folder = names
            .filter_map(|name| name.strip_suffix("data.pkl").map(str::to_owned))
            .min_by_key(String::len);
        let folder = folder.ok_or_else(|| record("data.pkl", "in the archive", "none"))?;
        Ok(Archive { zip, folder })
    }

    fn take(&mut self, name: &str, limit: usize) -> Result<Vec<u8>, ExchangeError> {
        let found = self.find(name, limit)?;
        found.ok_or_else(|| record(name, "in the archive", "none"))
    }

    /// None where there is no such record. A length in the archive is not believed: reading ends after `limit`.
    fn find(&mut self, name: &str, limit: usize) -> Result<Option<Vec<u8>>, ExchangeError> {
        let file = match self.zip.by_name(&format!("{}{name}", self.folder)) {
            Err(ZipError::FileNotFound) => return Ok(None),
            other => other.map_err(damaged)?,
        };
        let mut contents = vec![];
        let read = file.take(limit as u64 + 1).read_to_end(&mut contents);
        read.map_err(|cause| record(name, "a sound record", &cause.to_string()))?;
        if contents.len() > limit {
            return Err(record(
                name,
                &format!("at most {limit} bytes"),
                "more of them",
            ));
        }
        Ok(Some(contents))
    }
}

fn record(name: &str, expected: &str, found: &str) -> ExchangeError {
    ExchangeError::Record {
        record: name.into(),
        expected: expected.into(),
        found: found.into(),
    }
}

fn damaged(cause: ZipError) -> ExchangeError {
    ExchangeError::Container {
        cause: cause.to_string(),
    }
}
