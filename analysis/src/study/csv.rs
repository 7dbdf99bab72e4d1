//! `study.csv`: one line for every run and compared frame.

use std::fmt::Write;

use crate::study::record::{Distance, Figures, Study};

const HEAD: &str = "setting,role,copy,repeat,seconds_a_frame,processor_seconds,peak_bytes,steps,cg_iterations,frame,time_s,\
rms_m,p99_m,max_m,velocity_rms_m_s,normal_rms_rad,surface_m,base_rms_m,base_p99_m,base_max_m,kinetic_energy_J,potential_energy_J,centre_x_m,\
centre_y_m,centre_z_m,momentum_x,momentum_y,momentum_z,max_strain,p99_strain,drape_area_m2,folds_30_m,folds_60_m,folds_90_m,\
on_bodies_m2,on_cloth_m2,gap_m,depth_m,crossings";

/// The whole table.
pub(super) fn csv(study: &Study) -> String {
    let mut text = format!("{HEAD}\n");
    for sample in &study.samples {
        // The names of roles are those of the record.
        let role = serde_json::to_value(sample.role).ok().and_then(|role| role.as_str().map(str::to_owned));
        let cost = &sample.cost;
        let run = format!(
            "\"{}\",{},{},{},{},{},{},{},{}",
            sample.setting.label.replace('"', "\"\""),
            role.unwrap_or_default(),
            sample.copy,
            sample.repeat,
            sample.seconds_a_frame(),
            cost.processor_seconds,
            cost.peak_bytes.map_or(String::new(), |bytes| bytes.to_string()),
            cost.steps,
            cost.cg_iterations
        );
        for (at, figures) in sample.figures.iter().enumerate() {
            let frame = study.compared.get(at).copied().unwrap_or_default();
            let (reference, base) = (sample.from_reference.get(at), sample.from_base.get(at));
            let numbers = [distances(reference, true), distances(base, false), of_cloth(figures)].concat();
            // Writing into a text cannot fail.
            let _ = writeln!(text, "{run},{frame},{},{}", study.time(frame), numbers.join(","));
        }
    }
    text
}

fn distances(distance: Option<&Distance>, all: bool) -> Vec<String> {
    let field = |of: fn(&Distance) -> f64| distance.map_or(String::new(), |distance| of(distance).to_string());
    let mut fields = vec![field(|d| d.rms), field(|d| d.p99), field(|d| d.max)];
    if all {
        fields.push(field(|d| d.velocity_rms));
        fields.push(field(|d| d.normal_rms));
        fields.push(optional(distance.and_then(|distance| distance.surface)));
    }
    fields
}

fn of_cloth(figures: &Figures) -> Vec<String> {
    let Figures { kinetic_energy, potential_energy, centre, momentum, strain, drape_area, folds, .. } = figures;
    let (energies, area) = ([*kinetic_energy, *potential_energy], [*drape_area]);
    let numbers: [&[f64]; 6] = [&energies, centre, momentum, strain, &area, folds];
    let mut fields: Vec<String> = numbers.concat().iter().map(f64::to_string).collect();
    fields.extend(figures.contact_area.iter().map(f64::to_string));
    fields.extend([optional(figures.gap), figures.depth.to_string(), figures.crossings.to_string()]);
    fields
}

fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::record::Sample;

    #[test]
    fn every_line_has_as_many_fields_as_the_head() {
        let sample = Sample { figures: vec![Figures::default()], ..Sample::default() };
        let compared = Sample { from_reference: vec![Distance::default()], ..sample.clone() };
        let study = Study { compared: vec![7], samples: vec![sample, compared], ..Study::default() };
        let text = csv(&study);
        let fields: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(fields, [fields[0]; 3], "{text}");
    }
}
