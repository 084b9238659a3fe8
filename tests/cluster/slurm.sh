# shellcheck shell=bash
# A Slurm cluster of three nodes on this machine, for root, without systemd; to be sourced. Everything lies in the folder $work.
#
# Each node is a slurmd in a process namespace of its own: when its first process is killed, all of the node dies at once, jobs and all, as if
# its power had gone, and nothing of it can stay behind.

readonly NODES=3
: "${work:=}"

declare -A node_process=()

slurm_missing() {
    local program
    for program in munged slurmctld slurmd sbatch scontrol unshare; do
        command -v "$program" > /dev/null || { echo "$program is missing (Debian: apt install slurm-wlm munge)"; return 0; }
    done
    ((EUID == 0)) || { echo "slurmd has to be started by root"; return 0; }
    unshare --fork --pid --mount-proc true 2> /dev/null || { echo "process namespaces are not allowed here"; return 0; }
    return 1
}

slurm_start() {
    local host node port
    host=$(hostname -s)
    port=$((20000 + $$ % 10000))
    mkdir -p "$work/slurm/state"
    (umask 077 && head -c 1024 /dev/urandom > "$work/slurm/munge.key")
    cat > "$work/slurm/slurm.conf" <<CONF
ClusterName=fanal
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/slurm/munge.socket
CredType=cred/munge
StateSaveLocation=$work/slurm/state
SlurmdSpoolDir=$work/slurm/spool-%n
SlurmctldPidFile=$work/slurm/slurmctld.pid
SlurmdPidFile=$work/slurm/slurmd-%n.pid
SlurmctldLogFile=$work/slurm/slurmctld.log
SlurmdLogFile=$work/slurm/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SlurmdTimeout=10
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
NodeName=n[1-$NODES] NodeHostname=$host NodeAddr=127.0.0.1 Port=[$((port + 1))-$((port + NODES))] CPUs=1 RealMemory=8000
PartitionName=main Nodes=n[1-$NODES] Default=YES
CONF
    export SLURM_CONF=$work/slurm/slurm.conf
    munged --foreground --force --key-file="$work/slurm/munge.key" --socket="$work/slurm/munge.socket" --pid-file="$work/slurm/munged.pid" \
        --log-file="$work/slurm/munged.log" --seed-file="$work/slurm/munge.seed" > "$work/slurm/munged.out" 2>&1 &
    munge_process=$!
    until_true 20 test -S "$work/slurm/munge.socket"
    slurmctld -D -i > "$work/slurm/slurmctld.out" 2>&1 &
    controller_process=$!
    until_true 20 scontrol ping
    for ((node = 1; node <= NODES; node++)); do
        node_start "n$node"
    done
    until_true 60 nodes_idle "$NODES"
}

node_start() {
    unshare --fork --pid --mount-proc --kill-child slurmd -D -N "$1" > "$work/slurm/$1.out" 2>&1 &
    node_process[$1]=$!
}

# The node's power goes: SIGKILL for every process on it.
node_kill() {
    kill -KILL "${node_process[$1]}"
    wait "${node_process[$1]}" 2> /dev/null || true
    unset "node_process[$1]"
}

slurm_stop() {
    local node
    for node in "${!node_process[@]}"; do
        node_kill "$node"
    done
    kill ${controller_process:+"$controller_process"} 2> /dev/null && wait "$controller_process" 2> /dev/null
    kill ${munge_process:+"$munge_process"} 2> /dev/null && wait "$munge_process" 2> /dev/null
    return 0
}

nodes_idle() {
    (($(sinfo --noheader --Node --format=%T | grep -c -x idle) == $1))
}

# Asks once a second for at most so many seconds.
until_true() {
    local seconds=$1
    shift
    for ((; seconds > 0; seconds--)); do
        ! "$@" > /dev/null 2>&1 || return 0
        sleep 1
    done
    echo "tests/cluster: not so after a while: $*" >&2
    return 1
}
