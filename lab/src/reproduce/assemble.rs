//! The report: what was judged, made into rows, figures, pictures, JSON and a page.

use super::combine::combine;
use super::evaluate::{BOOTSTRAP_SEED, key, label_counts, read_model, setting_rules};
use super::evaluated::Evaluated;
use super::layout::write_whole;
use super::pictures::{figure6_scene, worst_scenes};
use super::real::real_rows;
use super::rows::{METHOD_NETWORKS, network_of, step_key};
use super::run::{Options, Screen, Test};
use super::simulate::Simulation;
use super::train::{BASE, NETWORKS, SEEDED, command_of};
use super::{ReproduceError, Setting};
use crate::dataset::Dataset;
use crate::dataset::data_hash;
use crate::evaluate::Kind;
use crate::methods::improved_steps;
use crate::report::{
    AblationRow, Data, Details, NetworkDetails, Provenance, Report, Scene, document, figure5,
    figure6, method_row, worst,
};
use mluc_gateway::picture::Canvas;
use std::collections::BTreeMap;
use std::path::Path;

/// Rows with a page of the frames in which they did worst: ours, and the paper's with its slips mended.
const WORST_OF: [&str; 2] = ["improved", "mluc-corrected"];

/// Rows, figures, pictures, JSON, page.
pub(super) fn write_report(
    options: &Options,
    tests: &BTreeMap<Setting, Test>,
    screen: &dyn Screen,
) -> Result<Report, ReproduceError> {
    let mut report = Report {
        provenance: provenance(options),
        ..Report::default()
    };
    let (mut scenes, mut worst_of) = (Vec::<Scene>::new(), Vec::new());
    for (&setting, test) in tests {
        let evaluated = evaluations(options, test)?;
        let rows = evaluated
            .iter()
            .filter_map(|(method, seeds)| Some(((*method).to_owned(), combine(seeds)?)));
        report
            .settings
            .insert(setting.name().to_owned(), rows.collect());
        let real = real_rows(&options.layout, test, &evaluated, &options.real, screen)?;
        let details = Details {
            ablation: ablation(options, test)?,
            real,
            ..details(options, test, &evaluated)?
        };
        report.details.insert(setting.name().to_owned(), details);
        scenes.extend(figure6_scene(test, &evaluated)?);
        for method in WORST_OF {
            if let Some(first) = evaluated.get(method).and_then(|seeds| seeds.first()) {
                worst_of.push((setting, method, worst_scenes(test, first)?));
            }
        }
    }
    if report.settings.values().all(BTreeMap::is_empty) {
        let path = options.layout.runs.clone();
        return Err(ReproduceError::NoNetworks { path });
    }
    let out = &options.layout.out;
    let mut pictures = Vec::new();
    let curves = figure5::figure5(&report);
    write_whole(&out.join("figure5.svg"), curves.to_svg().as_bytes())?;
    write_png(&out.join("figure5.png"), &curves.to_canvas(2.0))?;
    let what = "Figure 5: AP of the unknown and mAP of the known over the recall of the unknown, one curve a method";
    pictures.push(("figure5.svg".to_owned(), what.to_owned()));
    if !scenes.is_empty() {
        write_png(&out.join("figure6.png"), &figure6::figure6(&scenes))?;
        let what = "Figure 6: the frame with most unknown objects within 32 m, as labelled and as each method sees it; unknown objects \
                    are shown down to the score at which a method has one false alarm a frame, known ones from 0.3";
        pictures.push(("figure6.png".to_owned(), what.to_owned()));
    }
    for (setting, method, scenes) in worst_of.iter().filter(|(.., scenes)| !scenes.is_empty()) {
        let file = format!("worst-{}-{method}.png", setting.name());
        write_png(&out.join(&file), &worst::worst(scenes))?;
        let title = method_row(method).map_or(*method, |row| row.title);
        let what = format!(
            "{title}: the frames of {} with most errors about unknown objects",
            setting.name()
        );
        pictures.push((file, what));
    }
    let json = serde_json::to_vec_pretty(&report).map_err(|e| ReproduceError::io(out)(e.into()))?;
    write_whole(&out.join("report.json"), &json)?;
    write_whole(
        &out.join("README.md"),
        document(&report, &pictures).as_bytes(),
    )?;
    Ok(report)
}

fn write_png(path: &Path, canvas: &Canvas) -> Result<(), ReproduceError> {
    let mut bytes = Vec::new();
    canvas
        .write_png(&mut bytes)
        .map_err(|e| ReproduceError::Picture {
            path: path.to_owned(),
            reason: e.to_string(),
        })?;
    write_whole(path, &bytes)
}

/// Every evaluation of a setting that is up to date, by row, the first seed first.
fn evaluations(
    options: &Options,
    test: &Test,
) -> Result<BTreeMap<&'static str, Vec<Evaluated>>, ReproduceError> {
    let (layout, setting) = (&options.layout, test.setting);
    let resamples = options.sizes(setting).resamples;
    let mut found: BTreeMap<&'static str, Vec<Evaluated>> = BTreeMap::new();
    for (method, network) in METHOD_NETWORKS {
        for seed in 1..=options.seeds {
            if !layout.model_of(setting, network, seed).is_file() {
                continue;
            }
            let key = key(
                &read_model(layout, setting, network, seed)?,
                test,
                resamples,
            );
            let path = layout.evaluation_of(setting, method, seed);
            found
                .entry(method)
                .or_default()
                .extend(Evaluated::read(&path, &key));
        }
    }
    found.retain(|_, seeds| !seeds.is_empty());
    Ok(found)
}

/// The improved method after each of its steps, as far as it was judged.
fn ablation(options: &Options, test: &Test) -> Result<Vec<AblationRow>, ReproduceError> {
    let (layout, setting) = (&options.layout, test.setting);
    if !layout.model_of(setting, "improved", 1).is_file() {
        return Ok(Vec::new());
    }
    let resamples = options.sizes(setting).resamples;
    let model = read_model(layout, setting, "improved", 1)?;
    let key = key(&model, test, resamples);
    let steps = improved_steps(&model);
    let count = steps.len();
    let steps = steps.into_iter().enumerate();
    let rows = steps.filter_map(|(at, (step, _))| {
        let kept = match at + 1 == count {
            // With every step it is the row itself.
            true => Evaluated::read(&layout.evaluation_of(setting, "improved", 1), &key)?,
            false => Evaluated::read(&layout.evaluation_of(setting, &step_key(at), 1), &key)?,
        };
        Some(AblationRow {
            step: step.to_owned(),
            figures: combine(&[kept])?,
        })
    });
    Ok(rows.collect())
}

/// Kinds whose boxes carry scores that tell unknown from known: told of the first network of each.
const SCORED: [&str; 4] = [BASE, "softmax", "metric-open", "improved"];

fn details(
    options: &Options,
    test: &Test,
    evaluated: &BTreeMap<&'static str, Vec<Evaluated>>,
) -> Result<Details, ReproduceError> {
    let (layout, setting) = (&options.layout, test.setting);
    let counts = label_counts(&test.set, &setting_rules(setting)?)?;
    let of_kind = |kind| counts.iter().filter(move |(_, k, _)| *k == kind);
    let mut details = Details {
        unknown_labels: of_kind(Kind::Unknown).map(|(_, _, n)| n).sum(),
        known_labels: of_kind(Kind::Known)
            .map(|(c, _, n)| (c.clone(), *n))
            .collect(),
        data: data(options, test)?,
        ..Details::default()
    };
    let rows = evaluated.values().flatten();
    let mut networks: Vec<(&str, u64, &Evaluated)> =
        rows.map(|e| (network_of(&e.method), e.seed, e)).collect();
    networks.sort_by_key(|(network, seed, _)| (NETWORKS.iter().position(|n| n == network), *seed));
    networks.dedup_by_key(|(network, seed, _)| (*network, *seed));
    for (network, seed, evaluated) in networks {
        let model = read_model(layout, setting, network, seed)?;
        let provenance = &model.manifest.provenance;
        details.networks.push(NetworkDetails {
            network: network.to_owned(),
            seed,
            steps: provenance.steps,
            batch: provenance.batch,
            command: command_of(&layout.run_of(setting, network, seed)),
            commit: provenance.commit.clone(),
            fingerprint: format!("{:016x}", model.fingerprint),
            separation: match seed == 1 && SCORED.contains(&network) {
                true => evaluated.separation.clone(),
                false => Vec::new(),
            },
        });
    }
    Ok(details)
}

fn data(options: &Options, test: &Test) -> Result<Vec<Data>, ReproduceError> {
    let sizes = options.sizes(test.setting);
    let mut data = Vec::new();
    for simulation in Simulation::all(&options.layout, test.setting, &sizes) {
        let hash = match (simulation.name, simulation.folder.is_dir()) {
            ("test", _) => test.hash.clone(),
            (_, true) => data_hash(
                &Dataset::open(&simulation.folder)?,
                simulation.frames as usize,
            )?,
            (_, false) => continue,
        };
        data.push(Data {
            split: simulation.name.to_owned(),
            frames: simulation.frames as usize,
            command: simulation.command(),
            hash,
        });
    }
    if data.is_empty() {
        data.push(Data {
            split: "test".to_owned(),
            frames: test.set.len(),
            command: "given".to_owned(),
            hash: test.hash.clone(),
        });
    }
    Ok(data)
}

fn provenance(options: &Options) -> Provenance {
    Provenance {
        commit: options.commit.clone(),
        command: options.command.clone(),
        size: options.size.name().to_owned(),
        bootstrap: [
            options
                .settings
                .first()
                .map_or(0, |s| options.sizes(*s).resamples as u64),
            BOOTSTRAP_SEED,
        ],
        threads: rayon::current_num_threads(),
        training: format!(
            "One long training a setting makes the base network (`{BASE}`); each other network begins with the base's weights and is \
             trained for fewer steps (`osis` with those of `softmax`), so the rows share most of their training. Further seeds ({}) \
             begin with the same base: their spread is that of the last part of the training. Networks that lay in the runs' folder \
             already are taken as they are and listed as given.",
            SEEDED.join(", ")
        ),
    }
}
