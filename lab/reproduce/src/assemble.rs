//! The report: evaluations become rows, figures, pictures, JSON and a page.

use crate::evaluate::{BOOTSTRAP_SEED, key, read_model, setting_rules, step_key};
use crate::methods::{METHODS, Method, full_steps};
use crate::options::{Options, Screen, TestFrames, Tests};
use crate::report::{ReproductionReport, figure5, figure6, page};
use crate::train::{BASE, NETWORKS, command_of};
use crate::{Layout, Result, combine::combine, layout::write_whole, pictures::figure6_scene};
use crate::{evaluated::ByRow, evaluated::Evaluated, real::real_rows, simulate::Simulation};
use mluc_dataset::{Dataset, data_hash};
use mluc_evaluate::{EvaluateError, JudgedFrames, LabelledFrame};
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::Path, path::PathBuf};

const FIGURE_5: &str = "Figure 5: AP of the unknown and mAP of the known over the recall of the unknown, one curve a method";
const FIGURE_6: &str = "Figure 6: the frame with most unknown objects within 32 m, as labelled and as each method sees it; unknown \
    objects are shown down to the score at which a method has one false alarm a frame, known ones from 0.3";

/// Writes all files of the report, and returns the page's path.
pub(crate) fn write_report(options: &Options, tests: &Tests, tell: &dyn Screen) -> Result<PathBuf> {
    let layout = &options.layout();
    let mut report =
        ReproductionReport { provenance: provenance(options), ..ReproductionReport::default() };
    let mut by_setting = Vec::new();
    for test in tests.values() {
        let name = test.setting.name().to_owned();
        let evaluated = evaluations(options, test)?;
        let row =
            |(method, of): (&&str, &Vec<Evaluated>)| Some(((*method).to_owned(), combine(of)?));
        let rows = evaluated.iter().filter_map(row).collect();
        report.settings.insert(name.clone(), rows);
        let mut details = details(options, test, &evaluated)?;
        let real = real_rows(layout, test, &evaluated, &options.real, tell)?;
        details["real"] = json!(real);
        report.details.insert(name, details);
        by_setting.push((test, evaluated));
    }
    let out = &layout.out;
    let pictures = write_pictures(out, &report, &by_setting)?;
    let json = serde_json::to_vec_pretty(&report).map_err(|e| EvaluateError::file(out, e))?;
    write_whole(&out.join("report.json"), &json)?;
    let page = page(&report, &pictures);
    let path = out.join("README.md");
    write_whole(&path, page.as_bytes())?;
    Ok(path)
}

/// Writes every picture; returns each file with its description.
fn write_pictures(
    out: &Path,
    report: &ReproductionReport,
    by_setting: &[(&TestFrames, ByRow)],
) -> Result<Vec<(String, String)>> {
    let write = |file: &str, bytes: &[u8]| write_whole(&out.join(file), bytes);
    let mut pictures = vec![("figure5.svg".to_owned(), FIGURE_5.to_owned())];
    let curves = figure5::svg(report).map_err(|what| EvaluateError::file(out, what))?;
    write("figure5.svg", curves.as_bytes())?;
    let mut scenes = Vec::new();
    for (test, evaluated) in by_setting {
        scenes.extend(figure6_scene(test, evaluated)?);
    }
    if !scenes.is_empty() {
        write("figure6.png", &figure6(&scenes).png())?;
        pictures.push(("figure6.png".to_owned(), FIGURE_6.to_owned()));
    }
    Ok(pictures)
}

/// Every up-to-date evaluation of a setting.
fn evaluations(options: &Options, test: &TestFrames) -> Result<ByRow> {
    let (layout, setting) = (&options.layout(), test.setting);
    let mut found = ByRow::new();
    for row in METHODS.iter() {
        for seed in 1..=options.seeds {
            let run = (setting, row.network, seed);
            if layout.model_of(run).is_file() {
                let key = key(&read_model(layout, run)?, test);
                let path = layout.evaluation_of(setting, &row.key, seed);
                found.entry(&row.key).or_default().extend(Evaluated::read(&path, &key));
            }
        }
    }
    Ok(found)
}

/// Our method after each of its steps, for the steps that were evaluated.
fn ablation(options: &Options, test: &TestFrames) -> Result<Vec<Value>> {
    let (layout, setting, row) = (&options.layout(), test.setting, Method::MlucFull.row());
    let run = (setting, row.network, 1);
    if !layout.model_of(run).is_file() {
        return Ok(Vec::new());
    }
    let model = read_model(layout, run)?;
    let key = key(&model, test);
    let steps = full_steps(&model);
    let keys = (0..steps.len() - 1).map(step_key);
    // With all steps it is the row itself.
    let keys = keys.chain([row.key.clone()]);
    let rows = steps.into_iter().zip(keys).filter_map(|(step, of_step)| {
        let kept = Evaluated::read(&layout.evaluation_of(setting, &of_step, 1), &key)?;
        Some(json!({"step": step, "figures": combine(&[kept])?}))
    });
    Ok(rows.collect())
}

fn details(options: &Options, test: &TestFrames, found: &ByRow) -> Result<Value> {
    let (layout, setting) = (&options.layout(), test.setting);
    let frames = (0..test.set.names().len()).map(|i| Ok(test.set.truth(i)?.with(&[])));
    let frames: Vec<LabelledFrame> = frames.collect::<Result<_>>()?;
    let rules = setting_rules(setting)?;
    let labels = JudgedFrames::of(&frames, &rules).all();
    let mut networks = Vec::new();
    for plan in NETWORKS.iter() {
        let network = plan.network;
        for seed in 1..=options.seeds {
            let mut rows = found.values().flatten();
            let is_it = |e: &&Evaluated| e.network == network.name() && e.seed == seed;
            let Some(row) = rows.find(is_it) else {
                continue;
            };
            let run = (setting, network, seed);
            let model = read_model(layout, run)?;
            let provenance = &model.manifest.provenance;
            // Only for the first seed, where the network has a score that separates unknown from known.
            let separation = row.separation.iter().filter(|_| seed == 1 && plan.scored);
            networks.push(json!({
                "network": row.network, "seed": seed, "steps": provenance.steps, "batch": provenance.batch,
                "command": portable(layout, &command_of(&layout.run_of(run))), "commit": provenance.commit,
                "fingerprint": format!("{:016x}", model.fingerprint),
                "separation": separation.collect::<Vec<_>>(),
            }));
        }
    }
    let known: BTreeMap<_, _> = labels.classes.into_iter().map(|c| (c.class, c.labels)).collect();
    Ok(json!({
        "unknown_labels": labels.unknown_labels, "known_labels": known,
        "data": data(options, test)?, "networks": networks, "ablation": ablation(options, test)?,
    }))
}

/// A command with the folders' default names: a report contains no paths of a machine.
fn portable(layout: &Layout, command: &str) -> String {
    let [data, runs] = [&layout.data, &layout.runs].map(|folder| format!(" {}/", folder.display()));
    command.replace(&data, " data/").replace(&runs, " runs/")
}

/// Source of each split; hashes are FNV-1a over all labels, the sizes of all scans and the bytes of every 50th scan.
fn data(options: &Options, test: &TestFrames) -> Result<Vec<Value>> {
    let (layout, sizes) = (&options.layout(), options.sizes(test.setting));
    let mut data = Vec::new();
    for simulation in Simulation::all(layout, test.setting, &sizes) {
        let (frames, folder) = (simulation.options.frames, &simulation.options.folder);
        // Without training there may be fewer frames, or none.
        if simulation.is_done().unwrap_or(false) {
            let hash = data_hash(&Dataset::open(folder)?, frames as usize)?;
            let split = simulation.name;
            let command = portable(layout, &simulation.command());
            data.push(json!({"split": split, "frames": frames, "command": command, "hash": hash}));
        }
    }
    if data.is_empty() {
        let frames = test.set.names().len();
        let hash = &test.hash;
        data.push(json!({"split": "test", "frames": frames, "command": "given", "hash": hash}));
    }
    Ok(data)
}

fn provenance(options: &Options) -> Value {
    let mut settings = options.settings().into_iter();
    let draws = settings.next().map(|s| options.sizes(s).resamples);
    let seeded = NETWORKS.iter().filter(|n| n.seeded);
    let seeded: Vec<String> = seeded.map(|n| n.network.name()).collect();
    let training = format!(
        "One long training per setting makes the base network (`{}`); each other network begins with the base's weights and is \
             trained for fewer steps (`osis` with those of `softmax`), so the rows share most of their training. Further seeds ({}) \
             begin with the same base: their spread is that of the last part of the training. Networks that were already \
             in the runs' folder are used unchanged and are listed as given.",
        BASE.name(),
        seeded.join(", ")
    );
    let draws = draws.unwrap_or(0) as u64;
    json!({
        "commit": options.commit, "command": options.command(), "size": options.size(),
        "bootstrap": [draws, BOOTSTRAP_SEED], "threads": rayon::current_num_threads(), "training": training,
    })
}
