//! An evaluation as a text table.

use std::fmt::{Display, Formatter, Result};

use crate::evaluate::{BUCKETS, Evaluation, Row};

impl Display for Evaluation {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(
            f,
            "{} held-out trees; mean nodes: counted {:.0}, converged {:.0}; KL floor of the targets {:.4} nats",
            self.trees, self.input_nodes, self.target_nodes, self.floor
        )?;
        let [sigma, near, far, flat] = self.gaussian;
        writeln!(
            f,
            "Gaussian tuned to sigma {sigma} cells; near, far and equal shares count as {near}, {far} and {flat} samples"
        )?;
        writeln!(f, "\n1 + V, geometric means")?;
        header(f, self, ["mean", "V median", "V mean", "uniform", "us/tree", "nodes"])?;
        for row in &self.rows {
            let Row { moment, median_variance, mean_variance, uniform, microseconds, nodes, .. } = row;
            let columns = [*moment, *median_variance, *mean_variance, *uniform, *microseconds, *nodes];
            line(f, &row.name, columns, row.bucket_moments)?;
        }
        writeln!(f, "\nKL in nats")?;
        header(f, self, ["mean", "median", "- floor", "added", "removed", "nodes"])?;
        for row in &self.rows {
            let Row { kl, median_kl, kl_above_floor, nodes_added, nodes_removed, nodes, .. } = row;
            let columns = [*kl, *median_kl, *kl_above_floor, *nodes_added, *nodes_removed, *nodes];
            line(f, &row.name, columns, row.buckets)?;
        }
        writeln!(f, "\nKL that each level adds (1, 2, …)")?;
        for row in &self.rows {
            let levels: Vec<String> = row.levels.iter().map(|kl| format!("{kl:7.4}")).collect();
            writeln!(f, "{:<28}{}", row.name, levels.join(" "))?;
        }
        Ok(())
    }
}

fn header(f: &mut Formatter<'_>, evaluation: &Evaluation, columns: [&str; 6]) -> Result {
    write!(f, "{:<28}", "")?;
    columns.iter().try_for_each(|column| write!(f, "{column:>10}"))?;
    write!(f, " |")?;
    for (low, n) in BUCKETS.iter().zip(evaluation.bucket_trees) {
        write!(f, "{:>14}", format!("N>={low} ({n})"))?;
    }
    writeln!(f)
}

fn line(f: &mut Formatter<'_>, name: &str, columns: [f64; 6], buckets: [Option<f64>; 5]) -> Result {
    write!(f, "{name:<28}")?;
    columns.iter().try_for_each(|column| write!(f, "{column:>10.3}"))?;
    write!(f, " |")?;
    for value in buckets {
        write!(f, "{:>14}", value.map_or("-".to_owned(), |value| format!("{value:.4}")))?;
    }
    writeln!(f)
}
