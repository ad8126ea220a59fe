//! The report: what was judged, made into rows, figures, pictures, JSON and a page.

use crate::Setting;
use crate::combine::combine;
use crate::evaluate::{BOOTSTRAP_SEED, key, read_model, setting_rules, step_key};
use crate::evaluated::Evaluated;
use crate::layout::write_whole;
use crate::methods::{METHODS, Method, MethodRow, full_steps};
use crate::options::{Options, Screen, TestFrames};
use crate::pictures::{figure6_scene, worst_scenes};
use crate::real::real_rows;
use crate::report::{
    AblationRow, DataOrigin, Details, NetworkDetails, Provenance, ReproductionReport, figure5,
    figure6, page, worst_page,
};
use crate::simulate::Simulation;
use crate::train::{BASE, NETWORKS, command_of};
use mluc_dataset::{Dataset, data_hash};
use mluc_evaluate::{EvaluateError, JudgedFrames, LabelledFrame, NeighbourPolicy};
use mluc_gateway::picture::Canvas;
use std::collections::BTreeMap;
use std::path::Path;

/// Rows with a page of the frames in which they did worst: ours, and the paper's with its slips corrected.
const WORST_OF: [&str; 2] = ["mluc-full", "paper-corrected"];

/// Evaluations by the key of their row, the first seed first.
type ByRow = BTreeMap<&'static str, Vec<Evaluated>>;

/// Rows, figures, pictures, JSON, page.
pub(crate) fn write_report(
    options: &Options,
    tests: &BTreeMap<Setting, TestFrames>,
    screen: &dyn Screen,
) -> Result<(), EvaluateError> {
    let mut report = ReproductionReport {
        provenance: provenance(options),
        ..ReproductionReport::default()
    };
    let mut by_setting = Vec::new();
    for test in tests.values() {
        let name = test.setting.name().to_owned();
        let evaluated = evaluations(options, test)?;
        let rows = evaluated.iter();
        let rows = rows.filter_map(|(method, seeds)| Some(((*method).to_owned(), combine(seeds)?)));
        report.settings.insert(name.clone(), rows.collect());
        let real = real_rows(&options.layout, test, &evaluated, &options.real, screen)?;
        let details = Details {
            real,
            ..details(options, test, &evaluated)?
        };
        report.details.insert(name, details);
        by_setting.push((test, evaluated));
    }
    if report.settings.values().all(BTreeMap::is_empty) {
        let what = "expected a trained network of at least one kind (NETWORK/model.safetensors), found none";
        return Err(EvaluateError::file(&options.layout.runs, what));
    }
    let out = &options.layout.out;
    let pictures = write_pictures(out, &report, &by_setting)?;
    let json = serde_json::to_vec_pretty(&report).map_err(|e| EvaluateError::file(out, e))?;
    write_whole(&out.join("report.json"), &json)?;
    let page = page(&report, &pictures);
    write_whole(&out.join("README.md"), page.as_bytes())
}

/// Writes every picture; each file with what it shows.
fn write_pictures(
    out: &Path,
    report: &ReproductionReport,
    by_setting: &[(&TestFrames, ByRow)],
) -> Result<Vec<(String, String)>, EvaluateError> {
    let mut pictures = Vec::new();
    let drawn = |what| EvaluateError::file(out, what);
    let curves = figure5::svg(report).map_err(drawn)?;
    write_whole(&out.join("figure5.svg"), curves.as_bytes())?;
    write_png(
        &out.join("figure5.png"),
        &figure5::canvas(report).map_err(drawn)?,
    )?;
    let what = "Figure 5: AP of the unknown and mAP of the known over the recall of the unknown, one curve a method";
    pictures.push(("figure5.svg".to_owned(), what.to_owned()));
    let mut scenes = Vec::new();
    for (test, evaluated) in by_setting {
        scenes.extend(figure6_scene(test, evaluated)?);
    }
    if !scenes.is_empty() {
        write_png(&out.join("figure6.png"), &figure6(&scenes))?;
        let what = "Figure 6: the frame with most unknown objects within 32 m, as labelled and as each method sees it; unknown objects \
                    are shown down to the score at which a method has one false alarm a frame, known ones from 0.3";
        pictures.push(("figure6.png".to_owned(), what.to_owned()));
    }
    for (test, evaluated) in by_setting {
        for method in WORST_OF {
            let seeds = evaluated.get(method);
            let Some(first) = seeds.and_then(|seeds| seeds.first()) else {
                continue;
            };
            let scenes = worst_scenes(test, first)?;
            if scenes.is_empty() {
                continue;
            }
            let setting = test.setting.name();
            let file = format!("worst-{setting}-{method}.png");
            write_png(&out.join(&file), &worst_page(&scenes))?;
            let title = MethodRow::find(method).map_or(method, |row| &row.title);
            let what =
                format!("{title}: the frames of {setting} with most errors about unknown objects");
            pictures.push((file, what));
        }
    }
    Ok(pictures)
}

fn write_png(path: &Path, canvas: &Canvas) -> Result<(), EvaluateError> {
    write_whole(path, &canvas.png())
}

/// Every evaluation of a setting that is up to date.
fn evaluations(options: &Options, test: &TestFrames) -> Result<ByRow, EvaluateError> {
    let (layout, setting) = (&options.layout, test.setting);
    let mut found = ByRow::new();
    for row in METHODS.iter() {
        for seed in 1..=options.seeds {
            if layout.model_of(setting, row.network, seed).is_file() {
                let key = key(&read_model(layout, setting, row.network, seed)?, test);
                let path = layout.evaluation_of(setting, &row.key, seed);
                let seeds = found.entry(&row.key).or_default();
                seeds.extend(Evaluated::read(&path, &key));
            }
        }
    }
    found.retain(|_, seeds| !seeds.is_empty());
    Ok(found)
}

/// Our method after each of its steps, as far as it was judged.
fn ablation(options: &Options, test: &TestFrames) -> Result<Vec<AblationRow>, EvaluateError> {
    let (layout, setting, row) = (&options.layout, test.setting, Method::MlucFull.row());
    if !layout.model_of(setting, row.network, 1).is_file() {
        return Ok(Vec::new());
    }
    let model = read_model(layout, setting, row.network, 1)?;
    let key = key(&model, test);
    let steps = full_steps(&model);
    let last = steps.len() - 1;
    let rows = steps.into_iter().enumerate().filter_map(|(at, step)| {
        // With every step it is the row itself.
        let of_step = if at == last {
            row.key.clone()
        } else {
            step_key(at)
        };
        let kept = Evaluated::read(&layout.evaluation_of(setting, &of_step, 1), &key)?;
        Some(AblationRow {
            step: step.to_owned(),
            figures: combine(&[kept])?,
        })
    });
    Ok(rows.collect())
}

fn details(
    options: &Options,
    test: &TestFrames,
    evaluated: &ByRow,
) -> Result<Details, EvaluateError> {
    let (layout, setting) = (&options.layout, test.setting);
    let frames = (0..test.set.len()).map(|i| Ok(test.set.truth(i)?.with(&[])));
    let frames: Vec<LabelledFrame> = frames.collect::<Result<_, EvaluateError>>()?;
    let rules = setting_rules(setting, NeighbourPolicy::Official)?;
    let labels = JudgedFrames::of(&frames, &rules).all();
    let mut networks = Vec::new();
    for plan in NETWORKS.iter() {
        let network = plan.network;
        for seed in 1..=options.seeds {
            let mut rows = evaluated.values().flatten();
            let is_it = |e: &&Evaluated| e.network == network.name() && e.seed == seed;
            let Some(row) = rows.find(is_it) else {
                continue;
            };
            let model = read_model(layout, setting, network, seed)?;
            let provenance = &model.manifest.provenance;
            let mut separation = row.separation.clone();
            if seed > 1 || !plan.scored {
                separation.clear();
            }
            networks.push(NetworkDetails {
                network: row.network.clone(),
                seed,
                steps: provenance.steps,
                batch: provenance.batch,
                command: command_of(&layout.run_of(setting, network, seed)),
                commit: provenance.commit.clone(),
                fingerprint: format!("{:016x}", model.fingerprint),
                separation,
            });
        }
    }
    let known = labels.classes.into_iter();
    Ok(Details {
        unknown_labels: labels.unknown_labels,
        known_labels: known.map(|c| (c.class, c.labels)).collect(),
        data: data(options, test)?,
        networks,
        ablation: ablation(options, test)?,
        real: Vec::new(),
    })
}

fn data(options: &Options, test: &TestFrames) -> Result<Vec<DataOrigin>, EvaluateError> {
    let sizes = options.sizes(test.setting);
    let mut data = Vec::new();
    for simulation in Simulation::all(&options.layout, test.setting, &sizes) {
        let (frames, folder) = (simulation.options.frames, &simulation.options.folder);
        if folder.is_dir() {
            data.push(DataOrigin {
                split: simulation.name.to_owned(),
                frames: frames as usize,
                command: simulation.command(),
                hash: data_hash(&Dataset::open(folder)?, frames as usize)?,
            });
        }
    }
    if data.is_empty() {
        data.push(DataOrigin {
            split: "test".to_owned(),
            frames: test.set.len(),
            command: "given".to_owned(),
            hash: test.hash.clone(),
        });
    }
    Ok(data)
}

fn provenance(options: &Options) -> Provenance {
    let mut settings = options.settings.iter();
    let draws = settings.next().map(|s| options.sizes(*s).resamples);
    let seeded = NETWORKS
        .iter()
        .filter(|n| n.seeded)
        .map(|n| n.network.name());
    Provenance {
        commit: options.commit.clone(),
        command: options.command.clone(),
        size: options.size.name().to_owned(),
        bootstrap: [draws.unwrap_or(0) as u64, BOOTSTRAP_SEED],
        threads: rayon::current_num_threads(),
        training: format!(
            "One long training a setting makes the base network (`{}`); each other network begins with the base's weights and is \
             trained for fewer steps (`osis` with those of `softmax`), so the rows share most of their training. Further seeds ({}) \
             begin with the same base: their spread is that of the last part of the training. Networks that lay in the runs' folder \
             already are taken as they are and listed as given.",
            BASE.name(),
            seeded.collect::<Vec<_>>().join(", ")
        ),
    }
}
