use super::Format::{Bin, Las, Npy, NuScenes, Pcd, Ply};
use super::*;

const POINTS: [[f32; 4]; 3] =
    [[1.0, 2.0, 3.0, 0.5], [-4.0, 5.5, -6.0, 0.25], [7.0, -8.0, 9.0, 1.0]];

fn bytes<const N: usize>(points: &[[f32; N]]) -> Vec<u8> {
    points.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn converted(kind: Format, layout: &Layout, file: Vec<u8>) -> Result<(Vec<u8>, bool), SourceError> {
    let mut scan = Scan::default();
    let is_cut = kind.convert(layout, file, &mut scan)?;
    Ok((scan.bytes, is_cut))
}

/// The same points with a field between, as rows of f32 x, u16 ring, f64 y, f32 z, u8 intensity * 4.
fn rows(is_big_endian: bool) -> Vec<u8> {
    let mut out = vec![];
    for [x, y, z, intensity] in POINTS {
        let numbers = [
            x.to_le_bytes().to_vec(),
            7u16.to_le_bytes().to_vec(),
            f64::from(y).to_le_bytes().to_vec(),
            z.to_le_bytes().to_vec(),
            vec![(intensity * 4.0) as u8],
        ];
        for mut number in numbers {
            if is_big_endian {
                number.reverse();
            }
            out.extend(number);
        }
    }
    out
}

fn text() -> String {
    let line = |[x, y, z, i]: [f32; 4]| format!("{x} 7 {y} {z} {}\n", i * 4.0);
    POINTS.map(line).concat()
}

fn pcd(data: &str, body: &[u8]) -> Vec<u8> {
    let header = "# .PCD\nVERSION .7\nFIELDS x ring y z Intensity\nSIZE 4 2 8 4 1\nTYPE F U F F U\nCOUNT 1 1 1 1 1\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA ";
    [header.as_bytes(), data.as_bytes(), b"\n", body].concat()
}

fn ply(format: &str, body: &[u8]) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\ncomment a\nelement vertex 3\nproperty float x\nproperty ushort ring\nproperty double y\nproperty float z\n\
         property uchar scalar_Intensity\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    );
    [header.as_bytes(), body].concat()
}

fn npy(descr: &str, shape: &str, is_fortran: bool, body: &[u8]) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let header = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), body].concat()
}

/// Columns one after another, each byte a literal.
fn compressed() -> Vec<u8> {
    let rows = rows(false);
    let mut columns = vec![];
    for (start, bytes) in [(0, 4), (4, 2), (6, 8), (14, 4), (18, 1)] {
        columns.extend((0..3).flat_map(|i| rows[i * 19 + start..][..bytes].to_vec()));
    }
    let runs = columns.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat());
    let packed: Vec<u8> = runs.collect();
    let sizes = [packed.len() as u32, columns.len() as u32].map(u32::to_le_bytes);
    [sizes.as_flattened(), &packed].concat()
}

fn quarter() -> Layout {
    Layout { intensity_scale: 0.25, ..Layout::default() }
}

#[test]
fn the_same_points_come_from_every_format() {
    let named = |ring: &str| {
        let rest = "('y', '<f8'), ('z', '<f4'), ('intensity', '|u1')]";
        let descr = format!("[('x', '<f4'), {ring}, {rest}");
        npy(&descr, "(3,)", false, &rows(false))
    };
    let columns = (0..4).flat_map(|c| POINTS.map(|p| p[c].to_be_bytes()).concat());
    let columns: Vec<u8> = columns.collect();
    let five = POINTS.map(|[x, y, z, i]| [x, y, z, i * 255.0, 3.0]);
    let names = ["ring", "z", "time", "y", "intensity", "x"];
    let six = Layout { columns: names.map(String::from).to_vec(), ..Layout::default() };
    let turned = POINTS.map(|[x, y, z, i]| [3.0, z, 0.0, y, i, x]);
    let plain = Layout::default;
    let boolean = String::from_utf8(pcd("ascii", text().as_bytes())).unwrap();
    let old = boolean.replace("FIELDS", "COLUMNS").into_bytes();
    let boolean = boolean.replace("F F U", "F F B").into_bytes();
    let cases = [
        (Bin, plain(), bytes(&POINTS)),
        (Bin, six, bytes(&turned)),
        (NuScenes, plain(), bytes(&five)),
        (Npy, plain(), npy("'<f4'", "(3, 4)", false, &bytes(&POINTS))),
        (Npy, plain(), npy("'>f4'", "(3, 4)", true, &columns)),
        (Npy, quarter(), named("('ring', '|u1', (1, 2))")),
        (Npy, quarter(), named("('', '|V2')")),
        (Pcd, quarter(), pcd("ascii", text().as_bytes())),
        (Pcd, quarter(), boolean),
        (Pcd, quarter(), old),
        (Pcd, quarter(), pcd("binary", &rows(false))),
        (Pcd, quarter(), pcd("binary_compressed", &compressed())),
        (Ply, quarter(), ply("ascii", text().as_bytes())),
        (Ply, quarter(), ply("binary_little_endian", &rows(false))),
        (Ply, quarter(), ply("binary_big_endian", &rows(true))),
    ];
    for (number, (format, layout, file)) in cases.into_iter().enumerate() {
        let found = converted(format, &layout, file).unwrap();
        assert_eq!(found, (bytes(&POINTS), false), "case {number}, {format:?}");
    }
}

#[test]
fn a_cut_file_gives_its_whole_points_and_says_so() {
    let cut = |mut file: Vec<u8>| {
        file.truncate(file.len() - 5);
        file
    };
    let cases = [
        (Pcd, pcd("binary", &rows(false))),
        (Pcd, pcd("ascii", text().as_bytes())),
        (Ply, ply("binary_little_endian", &rows(false))),
        (NuScenes, vec![0; 60]),
    ];
    for (format, file) in cases {
        let (out, is_cut) = converted(format, &quarter(), cut(file)).unwrap();
        assert_eq!((out.len(), is_cut), (32, true), "{format:?}");
    }
    for (rest, is_long) in [([0; 40], false), ([1; 40], true)] {
        let file = pcd("binary", &[&rows(false)[..], &rest].concat());
        let (out, is_cut) = converted(Pcd, &quarter(), file).unwrap();
        assert_eq!((out, is_cut), (bytes(&POINTS), is_long));
    }
    let endless = npy("'<f4'", "(18446744073709551615, 3)", true, &[0; 24]);
    assert_eq!(converted(Npy, &quarter(), endless).unwrap(), (vec![], true));
}

#[test]
fn files_that_do_not_fit_are_named() {
    for (sizes, is_fine) in
        [(&[60, 80][..], false), (&[48, 61], true), (&[61], true), (&[0], true), (&[72], false)]
    {
        assert_eq!(check_columns(sizes, &[]).is_ok(), is_fine, "{sizes:?}");
    }
    // Sizes that fit four columns and five: points with a ring, without one, and none but missing returns.
    let rings = (0..200u8).map(|i| f32::from(i % 32));
    let five: Vec<_> = rings.clone().map(|v| [0.5, 1.0, 2.0, 0.5, v]).collect();
    let none: Vec<_> = rings.map(|v| [0.0, 0.0, 0.0, v]).collect();
    let starts = [bytes(&five), bytes(&POINTS.repeat(100)), bytes(&none)];
    let are_fine = starts.map(|start| check_columns(&[4000], &start).is_ok());
    assert_eq!(are_fine, [false, true, true]);
    // And those that fit four and three.
    let three = bytes(&[[8.0, -1.5, -0.5], [9.0, 1.0, -0.5]].repeat(200));
    let are_fine = [three, bytes(&none)].map(|start| check_columns(&[4800], &start).is_ok());
    assert_eq!(are_fine, [false, true]);
    // And those of seven and eight numbers, the fifth a ring.
    let seven = (0..400u16).map(|i| [1.5, -2.0, -1.5, 9.0, f32::from(i % 32), 0.1, -0.5]);
    let eight = seven.clone().map(|v| [v[0], v[1], v[2], v[3], v[4], v[5], 0.5, 0.25]);
    let starts = [bytes(&seven.collect::<Vec<_>>()), bytes(&eight.collect::<Vec<_>>())];
    let are_fine = starts.map(|start| check_columns(&[start.len() as u64], &start).is_ok());
    assert_eq!(are_fine, [false, false]);
    let changed = |from: &str, to: &str| {
        let text = String::from_utf8(pcd("ascii", b"")).unwrap();
        (Pcd, text.replace(from, to).into_bytes())
    };
    let files = [
        (Pcd, b"hello".to_vec()),
        changed(" x ", " a "),
        changed("SIZE 4 2", "SIZE 4 3"),
        changed("TYPE F", "TYPE f"),
        changed("POINTS 3\n", ""),
        (Pcd, pcd("zip", b"")),
        (Pcd, pcd("ascii", b"1 2\n")),
        (Ply, b"ply".to_vec()),
        (Npy, b"PK".to_vec()),
        (Npy, npy("'<f4'", "(3, 2)", false, b"")),
        (Npy, npy("[('x', '<f4'), ('y', '>f4'), ('z', '<f4')]", "(3,)", false, &[0; 36])),
    ];
    let lines = include_str!("tests/refused.txt").lines();
    assert_eq!(lines.clone().count(), files.len());
    for ((format, file), words) in files.into_iter().zip(lines) {
        let error = converted(format, &Layout::default(), file);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
    // Coordinates of a map in f32 have steps of half a metre.
    let map = Layout { origin: [500_000.0, 5_400_000.0, 100.0], ..Layout::default() };
    let error = converted(Bin, &map, bytes(&POINTS)).unwrap_err().to_string();
    assert!(error.contains("expected f64 or integers, found f32, in steps of 0.06 m"), "{error}");
}

#[test]
fn axes_that_mirror_are_found() {
    for (axes, mirrors) in [("x,y,z y,-x,z x,-y,-z", false), ("x,y,-z y,x,z -x,y,z", true)] {
        for axes in axes.split(' ').map(String::from) {
            let layout = Layout { axes, ..quarter() };
            assert_eq!(layout.mirrors(), mirrors, "{}", layout.axes);
        }
    }
}

#[test]
fn whole_numbers_of_text_are_nanoseconds() {
    let mut layout = quarter();
    layout.deskew = true;
    let file = String::from_utf8(pcd("ascii", text().as_bytes())).unwrap();
    let (file, mut scan) = (file.replace(" ring ", " t "), Scan::default());
    Pcd.convert(&layout, file.into_bytes(), &mut scan).unwrap();
    assert_eq!(scan.times_ns, [7.0; 3]);
    // A missing return has no time.
    layout.columns = ["x", "y", "z", "t"].map(String::from).to_vec();
    let (mut scan, file) = (Scan::default(), bytes(&[[1.0, 0.0, 0.0, 0.5], [0.0; 4]]));
    Bin.convert(&layout, file, &mut scan).unwrap();
    assert!(scan.times_ns[0] == 5e8 && scan.times_ns[1].is_nan());
}

/// A file that laspy wrote (`tests/las/make.py`), of a sensor at `x_m`: its numbers, and whether it is cut.
fn las(file: &[u8], x_m: f64) -> Result<(Vec<f32>, bool), String> {
    let layout = Layout { origin: [x_m, 5_400_000.0, 100.0], ..Layout::default() };
    let found = converted(Las, &layout, file.to_vec());
    let (bytes, is_cut) = found.map_err(|error| error.to_string())?;
    let numbers = bytes.as_chunks::<4>().0.iter();
    Ok((numbers.map(|v| f32::from_le_bytes(*v)).collect(), is_cut))
}

#[test]
fn surveys_are_read_and_damage_gives_what_is_whole() {
    let [first, sixth, seventh, packed]: [&[u8]; 4] = [
        include_bytes!("../../tests/las/1.las"),
        include_bytes!("../../tests/las/6.las"),
        include_bytes!("../../tests/las/7.las"),
        include_bytes!("../../tests/las/3.laz"),
    ];
    let far = "(--origin X,Y,Z says where the sensor is in them), found none, the first one at 500001.0,5400002.0,103.0";
    let help = "`pdal translate IN.laz OUT.las`";
    for (file, x_m, words) in [(first, 0.0, far), (packed, 500_000.0, help)] {
        let error = las(file, x_m).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
    for whole in [first, sixth, seventh] {
        let (found, is_cut) = las(whole, 500_000.0).unwrap();
        let off = found.iter().zip(POINTS.as_flattened());
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(found.len() == 12 && off < 1e-3 && !is_cut, "{found:?}");
        // Cut anywhere, or with a byte changed anywhere: an error or points, and no panic.
        for at in 0..whole.len() {
            let cut = las(&whole[..at], 500_000.0);
            assert!(cut.map_or(0, |(found, _)| found.len()) <= 12, "{at}");
            for bits in [0xff, 0x80, 0x01] {
                let mut changed = whole.to_vec();
                changed[at] ^= bits;
                let _ = las(&changed, 500_000.0);
            }
        }
    }
    let (found, is_cut) = las(&first[..first.len() - 5], 500_000.0).unwrap();
    assert_eq!((found.len(), is_cut), (8, true));
}
