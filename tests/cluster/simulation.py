"""A frame in parts on many nodes, event by event: what it takes with slow nodes and with nodes that fail.

All times are seconds. Random numbers come from the generator that the caller seeds, so that the same seed gives the same run.
"""

import heapq
import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """Work as one node does it.

    `work`: all samples, but for learning. `learning`: what has to be learned before any part can begin, on one node.
    """

    work: float
    learning: float = 0.0


@dataclass(frozen=True)
class Costs:
    """What dividing costs.

    `part`: each part, for its start, the scene, and writing. `dispatch`: from the end of a task to the begin of the next on its node.
    `merge` and `merge_part`: the merge, and what each part adds to it.
    """

    part: float = 0.0
    dispatch: float = 0.0
    merge: float = 0.0
    merge_part: float = 0.0

    def merging(self, parts):
        """Seconds of the merge."""
        return self.merge + self.merge_part * parts


@dataclass(frozen=True)
class Cluster:
    """Nodes and what happens to them.

    `slow_nodes`, `slow_tasks`: how uneven nodes are, and tasks on the same node: standard deviation of the logarithm of a log-normal slowdown
    whose mean is 1. `between_failures`: mean time between two failures of a node, exponentially distributed. A part that a failure ends
    has lost what it did since its last checkpoint (`checkpoints` apart), and may begin again `requeue` later; the node is back after `repair`.
    """

    nodes: int
    slow_nodes: float = 0.0
    slow_tasks: float = 0.0
    between_failures: float = math.inf
    checkpoints: float = math.inf
    requeue: float = 0.0
    repair: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """`time`: from the begin of learning to the merged picture. `busy`: node seconds that were asked for. `failures`: parts that were cut short."""

    time: float
    busy: float
    failures: int


def exact_time(frame, costs, nodes, parts):
    """What `run` gives where all nodes are alike and none fails."""
    rounds = math.ceil(parts / nodes)
    return frame.learning + rounds * (costs.dispatch + costs.part + frame.work / parts) + costs.merging(parts)


def slowdown(spread, random):
    return math.exp(random.gauss(0, spread) - spread**2 / 2) if spread else 1.0


class Nodes:
    """When nodes are free, how slow they are, and when they fail next."""

    def __init__(self, cluster, begin, random):
        self.cluster, self.random = cluster, random
        self.free = [(begin, node) for node in range(cluster.nodes)]
        self.slowness = [slowdown(cluster.slow_nodes, random) for _ in self.free]
        self.failure = [begin + self.until_failure() for _ in self.free]

    def until_failure(self):
        mean = self.cluster.between_failures
        return self.random.expovariate(1 / mean) if math.isfinite(mean) else math.inf

    def fail(self, node):
        """The node is back after its repair; returns when."""
        back = self.failure[node] + self.cluster.repair
        self.failure[node] = back + self.until_failure()
        return back

    def take(self, ready):
        """The node that is free first, and from when on, no earlier than `ready`; failures of idle nodes are behind it then."""
        while True:
            free, node = heapq.heappop(self.free)
            begin = max(free, ready)
            if self.failure[node] > begin:
                return begin, node
            heapq.heappush(self.free, (self.fail(node), node))

    def give_back(self, node, time):
        heapq.heappush(self.free, (time, node))


def run(frame, costs, cluster, parts, random):
    """Learns, renders `parts` parts and merges them, once."""
    nodes = Nodes(cluster, frame.learning, random)
    waiting = [(frame.learning, part, frame.work / parts) for part in range(parts)]
    end, busy, failures = frame.learning, frame.learning, 0
    while waiting:
        ready, part, left = heapq.heappop(waiting)
        begin, node = nodes.take(ready)
        begin += costs.dispatch
        pace = nodes.slowness[node] * slowdown(cluster.slow_tasks, random)
        done = begin + costs.part + left * pace
        failed = nodes.failure[node]
        if failed >= done:
            nodes.give_back(node, done)
            end, busy = max(end, done), busy + done - begin
            continue
        failures += 1
        busy += max(failed - begin, 0)
        heapq.heappush(waiting, (failed + cluster.requeue, part, left - kept(failed - begin - costs.part, pace, cluster.checkpoints)))
        nodes.give_back(node, nodes.fail(node))
    merging = costs.merging(parts)
    return Outcome(end + merging, busy + merging, failures)


def kept(traced, pace, checkpoints):
    """Work in the last checkpoint after so many seconds of tracing."""
    if traced < checkpoints:
        return 0.0
    return math.floor(traced / checkpoints) * checkpoints / pace
