"""The simulation against what can be computed: without randomness exactly, else to four standard errors over fixed seeds."""

import math
import random
import statistics
import unittest

from simulation import Cluster, Costs, Frame, exact_time, run

COSTS = Costs(part=2.0, dispatch=1.0, merge=5.0, merge_part=0.25)


def times(frame, costs, cluster, parts, runs, seed=1):
    source = random.Random(seed)
    return [run(frame, costs, cluster, parts, source).time for _ in range(runs)]


class Exact(unittest.TestCase):
    def test_alike_nodes_that_never_fail(self):
        for nodes, parts, learning in [(1, 1, 0), (1, 8, 0), (4, 4, 60), (4, 9, 60), (16, 7, 0), (1000, 8000, 300)]:
            frame = Frame(work=3600.0, learning=learning)
            outcome = run(frame, COSTS, Cluster(nodes), parts, random.Random(0))
            self.assertAlmostEqual(outcome.time, exact_time(frame, COSTS, nodes, parts), places=6)
            self.assertAlmostEqual(outcome.busy, 3600 + learning + 2 * parts + 5 + 0.25 * parts, places=6)
            self.assertEqual(outcome.failures, 0)

    def test_merges_while_the_rest_is_rendered(self):
        costs = Costs(part=2.0, dispatch=1.0, merge=5.0, merge_part=0.25, merged=4)
        # On one node all comes one after the other: ten parts, three merges.
        outcome = run(Frame(1000.0), costs, Cluster(1), 10, random.Random(0))
        self.assertAlmostEqual(outcome.time, 10 * (1 + 2 + 100) + 3 * (1 + 5) + 10 * 0.25, places=6)
        # Each round ends with a merge, for which one of four nodes begins the next round later.
        outcome = run(Frame(1200.0), costs, Cluster(4), 12, random.Random(0))
        self.assertAlmostEqual(outcome.time, 3 * (1 + 2 + 100) + 3 * (1 + 5 + 1), places=6)
        # Nodes are left over for the merges, of which only the last is waited for.
        outcome = run(Frame(1200.0), costs, Cluster(5), 12, random.Random(0))
        self.assertAlmostEqual(outcome.time, 3 * (1 + 2 + 100) + 1 + 5 + 1, places=6)

    def test_nodes_that_never_fail_in_time(self):
        frame, cluster = Frame(100.0), Cluster(4, between_failures=1e15, checkpoints=1.0, requeue=10.0, repair=10.0)
        self.assertEqual(times(frame, COSTS, cluster, 8, 1), [exact_time(frame, COSTS, 4, 8)])

    def test_same_seed_same_run(self):
        cluster = Cluster(16, slow_nodes=0.2, slow_tasks=0.2, between_failures=300, checkpoints=10, requeue=20, repair=60)
        self.assertEqual(times(Frame(3600.0), COSTS, cluster, 64, 3), times(Frame(3600.0), COSTS, cluster, 64, 3))


class Means(unittest.TestCase):
    def mean_is(self, values, mean):
        error = statistics.stdev(values) / math.sqrt(len(values))
        self.assertLess(abs(statistics.fmean(values) - mean), 4 * error, f"{statistics.fmean(values)} for {mean} (standard error {error})")

    def test_slowdowns_have_mean_one(self):
        for cluster in (Cluster(1, slow_nodes=0.5), Cluster(1, slow_tasks=0.5), Cluster(1, slow_nodes=0.3, slow_tasks=0.3)):
            self.mean_is(times(Frame(100.0), Costs(), cluster, 1, 20000), 100.0)

    def test_the_slowest_of_two(self):
        # The larger of two log-normals with mean 1: 2 Φ(σ / √2).
        sigma = 0.5
        mean = 2 * statistics.NormalDist().cdf(sigma / math.sqrt(2))
        self.mean_is(times(Frame(200.0), Costs(), Cluster(2, slow_tasks=sigma), 2, 20000), 100.0 * mean)

    def test_beginning_again_after_each_failure(self):
        # Without checkpoints a part of w seconds takes (1/λ + D) (exp(λ w) - 1) in the mean, D from failure to new begin (Daly 2006, without
        # failures in D); here the node's repair takes longer than the queue.
        rate, work, down = 1 / 100, 150.0, 40.0
        cluster = Cluster(1, between_failures=1 / rate, requeue=20.0, repair=down)
        self.mean_is(times(Frame(work - 2), Costs(part=2.0), cluster, 1, 20000), (1 / rate + down) * (math.exp(rate * work) - 1))

    def test_checkpoints_all_the_time(self):
        # Nothing is lost but the time until the node is back: w + λ w D.
        rate, work, down = 1 / 100, 150.0, 40.0
        cluster = Cluster(1, between_failures=1 / rate, checkpoints=1e-6, repair=down)
        self.mean_is(times(Frame(work), Costs(), cluster, 1, 20000), work * (1 + rate * down))


if __name__ == "__main__":
    unittest.main()
