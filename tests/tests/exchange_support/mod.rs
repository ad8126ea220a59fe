//! Checkpoints as PyTorch writes them, written here byte by byte: what the reader of the laboratory is tested with.
#![allow(dead_code)] // Each test file uses a part of it.

use mluc_model::{Network, Tensor, WeightSet};

/// A tensor of the state_dict: its name, shape and numbers.
pub(crate) type Entry = (String, Tensor);

/// A closed-set SECOND on KITTI with weights by formula, which sees nothing in an empty scene.
pub(crate) fn weights(network: &Network) -> WeightSet {
    let mut weights = mluc_model::formula_weights(network);
    if let Some(bias) = weights.find_mut("head.class.bias") {
        bias.data.fill(-30.0);
    }
    weights
}

/// Opcodes of pickle protocol 2.
#[derive(Default)]
pub(crate) struct Pickle(pub(crate) Vec<u8>);

impl Pickle {
    pub(crate) fn new() -> Pickle {
        Pickle(vec![0x80, 2])
    }

    pub(crate) fn raw(&mut self, bytes: &[u8]) -> &mut Pickle {
        self.0.extend_from_slice(bytes);
        self
    }

    pub(crate) fn text(&mut self, text: &str) -> &mut Pickle {
        self.raw(b"X")
            .raw(&(text.len() as u32).to_le_bytes())
            .raw(text.as_bytes())
    }

    pub(crate) fn integer(&mut self, value: usize) -> &mut Pickle {
        self.raw(b"J").raw(&(value as i32).to_le_bytes())
    }

    pub(crate) fn sizes(&mut self, sizes: &[usize]) -> &mut Pickle {
        self.raw(b"(");
        for size in sizes {
            self.integer(*size);
        }
        self.raw(b"t")
    }

    /// torch._utils._rebuild_tensor_v2(storage, 0, shape, stride, False, OrderedDict()).
    pub(crate) fn tensor(&mut self, class: &str, key: usize, shape: &[usize]) -> &mut Pickle {
        let count: usize = shape.iter().product();
        let strides: Vec<usize> = (0..shape.len())
            .map(|axis| shape[axis + 1..].iter().product())
            .collect();
        self.raw(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        self.text("storage")
            .raw(format!("ctorch\n{class}\n").as_bytes());
        self.text(&key.to_string()).text("cuda:0").integer(count);
        self.raw(b"tQ").integer(0).sizes(shape).sizes(&strides);
        self.raw(b"\x89ccollections\nOrderedDict\n)RtR")
    }

    /// {'epoch': 80, 'model_state': OrderedDict(...), 'optimizer_state': {'lr': numpy.float64(..)}}; storages are
    /// numbered as the tensors are. A counter as batch norm keeps them comes last.
    pub(crate) fn checkpoint(entries: &[Entry]) -> Pickle {
        let mut pickle = Pickle::new();
        pickle.raw(b"}q\x00(").text("epoch").integer(80);
        pickle
            .text("model_state")
            .raw(b"ccollections\nOrderedDict\nq\x01)Rq\x02(");
        for (key, (name, tensor)) in entries.iter().enumerate() {
            pickle.text(name).tensor("FloatStorage", key, &tensor.shape);
        }
        pickle
            .text("global_step")
            .tensor("LongStorage", entries.len(), &[1]);
        // The attributes of the state_dict.
        pickle.raw(b"u}").text("_metadata").raw(b"h\x01)Rsb");
        pickle.text("optimizer_state").raw(b"}").text("lr");
        pickle
            .raw(b"cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\n")
            .text("f8");
        pickle
            .raw(b"K\x00K\x01\x87R(K\x03")
            .text("<")
            .raw(b"NNNJ\xFF\xFF\xFF\xFFJ\xFF\xFF\xFF\xFFK\x00tb");
        pickle
            .raw(b"c_codecs\nencode\n")
            .text("12345678")
            .text("latin1");
        pickle.raw(b"\x86R\x86Rsu.");
        pickle
    }
}

fn little_endian(tensor: &Tensor) -> Vec<u8> {
    tensor.data.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// PyTorch's zip archive of a pickle and storages of f32 (and the counter).
pub(crate) fn archive(pickle: &Pickle, entries: &[Entry]) -> Vec<u8> {
    let mut records = vec![
        ("epoch_80/data.pkl".to_owned(), pickle.0.clone()),
        ("epoch_80/byteorder".to_owned(), b"little".to_vec()),
    ];
    for (key, (_, tensor)) in entries.iter().enumerate() {
        records.push((format!("epoch_80/data/{key}"), little_endian(tensor)));
    }
    records.push((format!("epoch_80/data/{}", entries.len()), vec![7; 8]));
    zip(&records)
}

/// PyTorch's format before 1.6.
pub(crate) fn legacy(pickle: &Pickle, entries: &[Entry]) -> Vec<u8> {
    let mut file =
        b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02M\xe9\x03.".to_vec();
    let mut system = Pickle::new();
    system.raw(b"}(").text("protocol_version").integer(1001);
    system.text("little_endian").raw(b"\x88u.");
    file.extend(system.0);
    file.extend(&pickle.0);
    let mut keys = Pickle::new();
    keys.raw(b"](");
    for key in 0..=entries.len() {
        keys.text(&key.to_string());
    }
    file.extend(&keys.raw(b"e.").0);
    for (_, tensor) in entries {
        file.extend((tensor.data.len() as u64).to_le_bytes());
        file.extend(little_endian(tensor));
    }
    file.extend(1_u64.to_le_bytes());
    file.extend([7; 8]);
    file
}

/// Records without compression: local headers, central directory, its end.
fn zip(records: &[(String, Vec<u8>)]) -> Vec<u8> {
    let (mut file, mut directory) = (vec![], vec![]);
    for (name, data) in records {
        let mut common = vec![20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        common.extend(crc32(data).to_le_bytes());
        common.extend((data.len() as u32).to_le_bytes());
        common.extend((data.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        let offset = file.len() as u32;
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(name.as_bytes());
        file.extend(data);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (start, count) = (file.len() as u32, records.len() as u16);
    file.extend(&directory);
    file.extend(b"PK\x05\x06\x00\x00\x00\x00");
    file.extend(count.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(start.to_le_bytes());
    file.extend([0, 0]);
    file
}

/// Of IEEE 802.3, a byte at a time.
fn crc32(data: &[u8]) -> u32 {
    let table: Vec<u32> = (0..256_u32)
        .map(|byte| {
            (0..8).fold(byte, |crc, _| match crc & 1 {
                1 => crc >> 1 ^ 0xEDB8_8320,
                _ => crc >> 1,
            })
        })
        .collect();
    !data.iter().fold(!0, |crc, byte| {
        crc >> 8 ^ table[((crc ^ u32::from(*byte)) & 0xFF) as usize]
    })
}
