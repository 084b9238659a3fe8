//! An evaluation as a table for people.

use crate::evaluate::{BUCKETS, Evaluation};

impl std::fmt::Display for Evaluation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} held-out trees; mean nodes: Q_h {:.0}, Q_gt {:.0}; KL floor of the targets {:.4} nats",
            self.trees, self.input_nodes, self.target_nodes, self.floor
        )?;
        let [sigma, near, far, flat] = self.gaussian;
        writeln!(
            f,
            "Gaussian tuned to sigma {sigma} cells; near, far and equal shares count as {near}, {far} and {flat} samples"
        )?;
        write!(f, "{:<28}{:>8}{:>8}{:>8}{:>8}{:>8} |", "KL in nats", "uniform", "mean", "median", "-floor", "V med")?;
        for (low, n) in BUCKETS.iter().zip(self.bucket_trees) {
            write!(f, "{:>14}", format!("N>={low} ({n})"))?;
        }
        writeln!(f, " | {:>7}{:>7}{:>8}{:>9}", "nodes", "added", "removed", "us/tree")?;
        for row in &self.rows {
            write!(
                f,
                "{:<28}{:>8.3}{:>8.4}{:>8.4}{:>8.4}{:>8.3} |",
                row.name, row.uniform, row.kl, row.median_kl, row.kl_above_floor, row.median_variance
            )?;
            for kl in row.buckets {
                write!(f, "{:>14}", kl.map_or("-".to_owned(), |kl| format!("{kl:.4}")))?;
            }
            let (added, removed) = (row.nodes_added, row.nodes_removed);
            writeln!(f, " | {:>7.0}{added:>7.0}{removed:>8.0}{:>9.1}", row.nodes, row.microseconds)?;
        }
        writeln!(f, "\nKL that each level adds (1, 2, …)")?;
        for row in &self.rows {
            let levels: Vec<String> = row.levels.iter().map(|kl| format!("{kl:7.4}")).collect();
            writeln!(f, "{:<28}{}", row.name, levels.join(" "))?;
        }
        Ok(())
    }
}
